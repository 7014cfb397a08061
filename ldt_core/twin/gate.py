"""The gate: which model comes into force, by samples that none of them has learned from."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment
from ldt_core.base.sentences import counted
from ldt_core.models.base import Model
from ldt_core.twin.training_data import JOINT_ERROR_RATIO, still_valid

#: Fewest samples of a block held back: a single one would be a free run of no step at all when it
#: is an experiment's first.
LEAST_BLOCK = 2


@dataclass(frozen=True)
class Offer:
    """A model that may take the present one's place."""

    model: Model
    origin: str
    details: dict[str, float] = field(default_factory=dict)


class Trial:
    """A comparison on blocks of time held back from some experiments.

    Every experiment is cut into 1 / `holdout` blocks. Candidates are trained without some of the
    blocks and predict them, and so do the models that are there already. It is a fair test, since

    - no model has learned from the samples it is judged by, and a candidate is judged with less
      data than it will have, which errs on the side of what is proven;
    - predictions are free runs from the experiment's first sample, exactly the twin's use, of which
      only the block held back counts;
    - the block's place rotates from experiment to experiment, and with fewer experiments than
      blocks the training is repeated until each place in time has been held back once.

    Args:
        judged: the experiments that blocks are held back from.
        holdout: share of each that is held back at a time, 0.5 at most.

    Raises:
        LdtError: an experiment is too short to hold anything back.
    """

    def __init__(self, judged: Sequence[Experiment], holdout: float) -> None:
        blocks = round(1 / holdout)
        shortest = min(len(e) for e in judged)
        if shortest < LEAST_BLOCK * blocks:
            raise LdtError(
                f"an experiment of {counted(shortest, 'sample')} is too short to hold back one in "
                f"{blocks} blocks"
            )
        self.judged = tuple(judged)
        rounds = math.ceil(blocks / len(self.judged))
        #: For each training, the block held back of each judged experiment.
        self.held = [
            [
                _block(e, (i + r * len(self.judged)) % blocks, blocks)
                for i, e in enumerate(self.judged)
            ]
            for r in range(rounds)
        ]

    @property
    def samples(self) -> int:
        """Samples on which a model is judged."""
        return sum(block.stop - block.start for held in self.held for block in held)

    def rmse(self, model: Model) -> float:
        """Error of a model that has not learned from the judged experiments [rad/s]."""
        residuals = [model.predict(e).residual(e) for e in self.judged]
        return self._rmse(
            float(np.sum(residual[block] ** 2))
            for held in self.held
            for residual, block in zip(residuals, held, strict=True)
        )

    def candidate(self, model: Model, others: Sequence[Experiment] = ()) -> tuple[float, Model]:
        """Error of what a model would become [rad/s], and a model that learns as it did.

        Args:
            others: experiments to learn from beside the judged ones, whole.

        Raises:
            LdtError: training failed.
        """
        squares, learner = [], model
        for held in self.held:
            nothing = [slice(len(e), len(e)) for e in others]
            trained = learner.fit_without([*others, *self.judged], [*nothing, *held])
            learner = model.shaped_like(trained)
            for e, block in zip(self.judged, held, strict=True):
                squares.append(float(np.sum(trained.predict(e).residual(e)[block] ** 2)))
        return self._rmse(squares), learner

    def _rmse(self, squares: Iterable[float]) -> float:
        return math.sqrt(sum(squares) / self.samples)


def _block(experiment: Experiment, place: int, blocks: int) -> slice:
    length = len(experiment)
    return slice(length * place // blocks, length * (place + 1) // blocks)


def best_offer(
    model: Model,
    earlier: Sequence[Model],
    learner: Model,
    pool: list[Experiment],
    judged: Sequence[Experiment],
    others: list[Experiment],
    holdout: float,
) -> Offer:
    """The decision: the model of least error on what is held back comes into force.

    Args:
        model: in force; it stays where no other does better.
        earlier: versions that were in force before.
        learner: that is to learn from the pool.
        pool: experiments to learn from, the newest last.
        judged: those of them that blocks are held back from.
        others: recent experiments that are learned from too where they are still valid.
        holdout: share of each judged experiment that is held back at a time.

    Raises:
        LdtError: no model could be trained.
    """
    trial = Trial(judged, holdout)
    present = trial.rmse(model)
    rmse, shaped = trial.candidate(learner, pool[: -len(judged)])
    pool = [*_valid(trial, rmse, shaped, pool, others), *pool]
    errors = [_rmse(trial, version) for version in earlier]
    known = min(errors, default=math.inf)
    details = {
        "experiments": len(pool),
        "candidate_rmse": min(rmse, known),
        "present_rmse": present,
        "held_back": trial.samples,
        "trainings": len(trial.held),
    }
    if not details["candidate_rmse"] < present:
        return Offer(model, "", details)
    if known <= rmse:
        best = earlier[errors.index(known)]
        again = best.again(model.version + 1)
        return Offer(again, f"is version {best.version} again", details)
    return Offer(learner.fit(pool), f"learned from {counted(len(pool), 'experiment')}", details)


def _rmse(trial: Trial, model: Model) -> float:
    """The error of a model that was left long ago, and may be unable to predict by now."""
    try:
        return trial.rmse(model)
    except LdtError:
        return math.inf


def _valid(
    trial: Trial, rmse: float, learner: Model, pool: list[Experiment], others: list[Experiment]
) -> list[Experiment]:
    """Those other experiments that are still valid, where the judged ones confirm it.

    What is alike to a model of the present machine is learned from alone, and has to predict the
    present experiment as well as that experiment's own samples did.
    """
    valid = still_valid(learner.fit(pool), rmse, others) if others else []
    if not valid or trial.rmse(learner.fit(valid)) > JOINT_ERROR_RATIO * rmse:
        return []
    return valid
