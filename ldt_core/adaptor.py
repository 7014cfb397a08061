"""The adaptor: what to do with an experiment, by the detector's answer (paper, section "Adaptor").

negative → nothing; warning → S_w ← S_w ∪ S_m; positive → a new model from S_w and the present
experiment, then S_w ← ∅. The paper takes every new model; here it has to pass a gate first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ldt_core.errors import LdtError
from ldt_core.experiment import Action, Adaptation, Experiment, Level, Signal
from ldt_core.memory import Memory
from ldt_core.models.base import Model
from ldt_core.settings import resolve

#: Fewest samples of a block held back: a single one would be a free run of no step at all when it
#: is an experiment's first.
LEAST_BLOCK = 2


class Adaptor:
    """Keeps, stores, adapts or refuses, once per experiment.

    The gate "holdout" cuts every experiment learned from into 1 / `holdout` blocks of time. Models
    trained without some of the blocks predict them, and so does the present model; the new one is
    adopted if its root mean square error over all blocks held back is the smaller. It is a fair
    test, since

    - neither model has learned from the samples it is judged by (the present one was trained
      before), and the new one is judged with less data than it will have, which errs on the side
      of what is proven;
    - predictions are free runs from the experiment's first sample, exactly the twin's use, of which
      only the block held back counts;
    - the block's place rotates from experiment to experiment, and with fewer experiments than
      blocks the training is repeated until each place in time has been held back once. So there
      are as many trainings as necessary (four with one experiment at a share of 0.25, one with four
      or more), and their cost stays about that of the final one.

    The model adopted is trained on everything, nothing held back.

    After a positive S_w is emptied, as in the paper, also when the new model was worse: what it
    holds stems from a machine that has gone on wearing since. (Kept for the next attempt instead,
    it raised the MME of the hybrid model by 3 % on average, in 7 of 8 runs of 60 experiments of the
    wearing rotor.) Only if no model could be trained is it kept, together with the present
    experiment: with more data there may be one.

    Args:
        model: the model to begin with.
        memory: S_w.
        gate: "holdout", or "none", which takes every model that could be trained, as in the paper.
        holdout: share of every experiment held back.

    Raises:
        OptionError: an argument outside its range (`parameters.yaml`).
    """

    def __init__(
        self, model: Model, memory: Memory, gate: str = "holdout", holdout: float = 0.25
    ) -> None:
        settings = resolve({"gate": gate, "holdout": holdout}, "adaptor")
        self.model = model
        self.memory = memory
        self.gate: str = settings["gate"]
        self.holdout: float = settings["holdout"]

    def step(self, experiment: Experiment, signal: Signal) -> tuple[Adaptation, Model]:
        """Deal with one experiment; (what was done, the model that goes on)."""
        details: dict[str, float] = {}
        if signal.level is Level.NEGATIVE:
            action, reason = Action.KEPT, "no drift, the model stays"
        elif signal.level is Level.WARNING:
            self.memory.store(experiment)
            action, details["dropped"] = Action.STORED, self.memory.dropped
            reason = f"warning, {_count(len(self.memory))} in the warning set"
        else:
            action, reason, details = self._learn(experiment)
        details["warning_set"] = len(self.memory)
        version = self.model.version
        return Adaptation(experiment.number, action, version, reason, details), self.model

    def _learn(self, experiment: Experiment) -> tuple[Action, str, dict[str, float]]:
        # One model has one sample period: a machine whose period has changed is learned anew.
        pool = [e for e in self.memory.union(experiment) if _same_period(e, experiment)]
        details: dict[str, float] = {"experiments": len(pool)}
        stays = f"version {self.model.version} stays"
        if not self.model.adaptive:
            self.memory.clear()
            return Action.REFUSED, f"a {self.model.kind} model does not learn; {stays}", details
        try:
            if self.gate == "holdout":
                details |= held_back_errors(self.model, pool, self.holdout)
                if not details["candidate_rmse"] < details["present_rmse"]:
                    self.memory.clear()
                    reason = f"no better on data held back: {_figures(details)}; {stays}"
                    return Action.REFUSED, reason, details
            self.model = self.model.fit(pool)
        except (LdtError, np.linalg.LinAlgError, ArithmeticError) as error:
            self.memory.store(experiment)
            return Action.REFUSED, f"no model could be trained: {error}; {stays}", details
        self.memory.clear()
        reason = f"version {self.model.version} learned from {_count(len(pool))}"
        if self.gate == "holdout":
            reason += f"; on data held back {_figures(details)}"
        return Action.ADAPTED, reason, details


def held_back_errors(model: Model, pool: Sequence[Experiment], holdout: float) -> dict[str, float]:
    """Compare a model with what it would become, on samples that neither has learned from.

    Args:
        model: the present model, not trained on the pool.
        pool: experiments to learn from.
        holdout: share of every experiment held back, 0.5 at most.

    Returns:
        candidate_rmse and present_rmse [rad/s] over held_back samples, in so many trainings.

    Raises:
        LdtError: an experiment is too short to hold anything back, or training failed.
    """
    blocks = round(1 / holdout)
    shortest = min(len(e) for e in pool)
    if shortest < LEAST_BLOCK * blocks:
        raise LdtError(
            f"an experiment of {shortest} samples is too short to hold back one in {blocks} blocks"
        )
    trainings = math.ceil(blocks / len(pool))
    present = [model.predict(e).residual(e) for e in pool]
    squares = {"candidate": 0.0, "present": 0.0}
    held_back = 0
    learner = model
    for training in range(trainings):
        places = [(i + training * len(pool)) % blocks for i in range(len(pool))]
        held = [_block(e, place, blocks) for e, place in zip(pool, places, strict=True)]
        candidate = learner.fit_without(pool, held)
        learner = model.shaped_like(candidate)
        for e, block, old in zip(pool, held, present, strict=True):
            new = candidate.predict(e).residual(e)
            squares["candidate"] += float(np.sum(new[block] ** 2))
            squares["present"] += float(np.sum(old[block] ** 2))
            held_back += block.stop - block.start
    rmse = {f"{name}_rmse": math.sqrt(total / held_back) for name, total in squares.items()}
    return {**rmse, "held_back": held_back, "trainings": trainings}


def _block(experiment: Experiment, place: int, blocks: int) -> slice:
    length = len(experiment)
    return slice(length * place // blocks, length * (place + 1) // blocks)


def _same_period(one: Experiment, other: Experiment) -> bool:
    return math.isclose(one.period, other.period, rel_tol=1e-6)


def _figures(details: dict[str, float]) -> str:
    return f"RMSE {details['candidate_rmse']:.4g} against {details['present_rmse']:.4g} rad/s"


def _count(experiments: int) -> str:
    return f"{experiments} experiment" + ("s" if experiments != 1 else "")
