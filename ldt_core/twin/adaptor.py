"""The adaptor: what to do with an experiment, by the detector's answer (paper, section "Adaptor").

negative → nothing; warning → S_w ← S_w ∪ S_m; positive → a new model, then S_w ← ∅. The paper
learns from S_w and the present experiment and takes every new model. Here, unless the paper's way
is asked for, the experiments are chosen by evidence and a new model has to pass a gate.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ldt_core.base.errors import LdtError, ModelError, RecordingError, reason_of
from ldt_core.base.experiment import (
    DOUBTFUL,
    FAILED,
    FAULTY,
    NO_MEMORY,
    PAUSED,
    Action,
    Adaptation,
    DiagnosisRecord,
    Experiment,
    Level,
    ModelRecord,
    Signal,
)
from ldt_core.base.model_state import shown_state
from ldt_core.base.own_process import undivided
from ldt_core.base.sentences import counted
from ldt_core.base.settings import resolve
from ldt_core.estimation.doubtful_speed import speed_doubt
from ldt_core.machine.experiment_limits import too_long_to_learn
from ldt_core.machine.sensor_check import fault
from ldt_core.models.base import Model
from ldt_core.recording.model_json import model_text, parse_model
from ldt_core.twin.gate import Offer, best_offer
from ldt_core.twin.memory import Memory
from ldt_core.twin.predictor import try_out
from ldt_core.twin.stage import Archive, RecordedStep
from ldt_core.twin.training_data import core

if TYPE_CHECKING:
    from ldt_core.twin.diagnoser import Diagnoser

#: Models that were in force before and may be again, beside the very first.
EARLIER = 8
#: In the details of an adaptation: learning from the experiment could not end in time.
TOO_LONG, TOO_SHORT = "too_long", "too_short"
#: In the details of an adaptation: the version that came into force again by hand.
ROLLED_BACK = "rolled_back_to"
#: In the details of an adaptation: the experiment is kept out of all that is ever learned from.
PASSED_OVER = (FAULTY, TOO_LONG, TOO_SHORT, PAUSED, FAILED)


class Adaptor:
    """Keeps, stores, adapts or refuses, once per experiment.

    With the gate "holdout" a new model is adopted if it predicts samples that it has not learned
    from better than the present one does, see `gate.Trial`; the model adopted is then trained on
    everything, nothing held back. An earlier model, the very first included, comes into force again
    if it does better still: a repaired machine is one that the twin knows already.

    With the data "evidence" a new model learns from the present experiment, from as many of the
    last ones as it takes to have seen the range in which the machine runs, and from the recent ones
    that are still valid, see `training_data`; these are left out without a gate, which is where
    that is judged. With "warning-set" it learns from S_w and the present experiment, as in the
    paper.

    After a positive S_w is emptied, as in the paper, also when the new model was worse: what it
    holds stems from a machine that has gone on wearing since. (Kept for the next attempt instead,
    it raised the MME of the hybrid model by 3 % on average, in 7 of 8 runs of 60 experiments of the
    wearing rotor.) Only if no model could be trained is it kept, together with the present
    experiment: with more data there may be one.

    An experiment whose speed no machine whatever can have is refused, whatever the signal
    (`sensor_check`). It comes into neither S_w nor the recent experiments: nothing is ever learned
    from it. One that only the machine file rules out is learned from, with a warning.

    Args:
        model: the model to begin with.
        memory: S_w and the recent experiments.
        gate: "holdout", or "none", which takes every model that could be trained, as in the paper.
        holdout: share of an experiment held back at a time.
        data: "evidence" or "warning-set".
        diagnoser: for a model that learns by the effect that a diagnosis names.
        sensor_check: whether implausible experiments are refused.
        restore: makes a model of its record; None takes the options of the model to begin with.

    Attributes:
        diagnosis: the verdict that the last experiment gave rise to, or None.

    Raises:
        OptionError: an argument outside its range (`parameters.yaml`).
    """

    def __init__(
        self,
        model: Model,
        memory: Memory,
        gate: str = "holdout",
        holdout: float = 0.25,
        data: str = "evidence",
        diagnoser: Diagnoser | None = None,
        sensor_check: bool = False,
        restore: Callable[[ModelRecord], Model] | None = None,
    ) -> None:
        given = {"gate": gate, "holdout": holdout, "data": data, "sensor_check": sensor_check}
        settings = resolve(given, "adaptor")
        self.model = model
        self._restore = restore or (
            lambda record: type(model).from_record(record, model.machine, **model.options)
        )
        self.memory = memory
        self.gate: str = settings["gate"]
        self.holdout: float = settings["holdout"]
        self.data: str = settings["data"]
        self.sensor_check: bool = settings["sensor_check"]
        #: Models that were in force before, the very first one first.
        self.earlier: list[Model] = []
        #: Recorded versions that nobody can use, each with the reason; see `recall`.
        self.unusable: dict[int, ModelError] = {}
        #: Whether the operator wants nothing to be learned at present.
        self.paused = False
        self.diagnoser = diagnoser
        self.diagnosis: DiagnosisRecord | None = None
        #: The last verdict that named a cause.
        self.named: DiagnosisRecord | None = None

    @undivided()
    def step(self, experiment: Experiment, signal: Signal) -> tuple[Adaptation, Model]:
        """Deal with one experiment; (what was done, the model that goes on).

        Whatever is raised, the experiment is refused with the reason, and the model stays.
        """
        self.diagnosis = None
        before = self.model, self.earlier
        if signal.statistics.get(FAILED):
            lacked = ", out of memory" if signal.statistics.get(NO_MEMORY) else ""
            return self._failed(experiment, f"the detector failed{lacked}"), self.model
        try:
            dealt = self._dealt(experiment, signal)
            if self.model is not before[0]:
                told = f"model version {self.model.version}"
                parse_model(told, model_text(self.model.record()))  # what nobody could use raises
                try_out(self.model, experiment)
            return dealt
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self.model, self.earlier = before
            return self._failed(experiment, reason_of(error)), self.model

    def _failed(self, experiment: Experiment, why: str) -> Adaptation:
        version = self.model.version
        reason = f"nothing is learned: {why}; version {version} stays"
        details = {FAILED: 1.0, "warning_set": len(self.memory)}
        return Adaptation(experiment.number, Action.REFUSED, version, reason, details)

    def _dealt(self, experiment: Experiment, signal: Signal) -> tuple[Adaptation, Model]:
        if passed_over := self._passed_over(experiment):
            return passed_over, self.model
        details: dict[str, float] = {}
        if self.diagnoser is not None:
            self.diagnosis = self.diagnoser.step(experiment, signal)
            if self.diagnosis is not None and self.diagnosis.cause:
                self.named = self.diagnosis
        known = shown_state(signal).known
        if signal.level is Level.NEGATIVE:
            action, reason = Action.KEPT, f"{known}; version {self.model.version} stays"
        elif signal.level is Level.WARNING:
            self.memory.store(experiment)
            action, details["dropped"] = Action.STORED, self.memory.dropped
            reason = f"{known}; {counted(len(self.memory), 'experiment')} in the warning set"
        else:
            action, reason, details = self._learn(experiment)
        self.memory.remember(experiment)
        details["warning_set"] = len(self.memory)
        version = self.model.version
        told = Adaptation(experiment.number, action, version, reason, details)
        return self._warned(told, experiment), self.model

    def _warned(self, told: Adaptation, experiment: Experiment) -> Adaptation:
        """What was done, with a warning where the machine file would rule the speed out."""
        if not self.sensor_check:
            return told
        words = speed_doubt(self.model.machine, experiment, self._recent(experiment))
        if not words:
            return told
        reason = f"{told.reason}; sensor or machine? {words}"
        return replace(told, reason=reason, details={**told.details, DOUBTFUL: 1})

    def _passed_over(self, experiment: Experiment) -> Adaptation | None:
        """What is said of one that is kept out of all that is ever learned from."""
        if self.paused:
            action, why, words = Action.KEPT, PAUSED, "switched off"
        elif self.sensor_check and (
            words := fault(self.model.machine, experiment, self._recent(experiment))
        ):
            action, why = Action.REFUSED, FAULTY
        elif words := too_long_to_learn(self.model.machine, experiment):
            action, why = Action.REFUSED, TOO_LONG
        elif len(experiment) < 2:
            action, why, words = Action.REFUSED, TOO_SHORT, "one sample shows no change"
        else:
            return None
        version = self.model.version
        reason = f"nothing is learned: {words}; version {version} stays"
        details = {why: 1, "warning_set": len(self.memory)}
        return Adaptation(experiment.number, action, version, reason, details)

    def _learn(self, experiment: Experiment) -> tuple[Action, str, dict[str, float]]:
        stays = f"version {self.model.version} stays"
        if not self.model.adaptive:
            self.memory.clear()
            return Action.REFUSED, f"a {self.model.kind} model does not learn; {stays}", {}
        pool = self._pool(experiment)
        learner = self.model.informed(self.named) if self.named else self.model
        try:
            tried = self._offer if self.gate == "holdout" else self._untried
            offer = tried(learner, pool)
        except (LdtError, np.linalg.LinAlgError, ArithmeticError) as error:
            self.memory.store(experiment)
            reason = f"no model could be trained: {error}; {stays}"
            return Action.REFUSED, reason, {"experiments": len(pool)}
        self.memory.clear()
        figures = _figures(offer.details)
        if offer.model is self.model:
            reason = f"no better on data held back: {figures}; {stays}"
            return Action.REFUSED, reason, offer.details
        before = self.model
        self._adopt(offer.model)
        reason = f"version {self.model.version} {offer.origin}"
        if change := self.model.change(before):
            reason = f"since experiment {self._since(experiment)}: {change}; {reason}"
        if figures:
            reason += f"; on data held back {figures}"
        return Action.ADAPTED, reason, offer.details

    def _adopt(self, model: Model) -> None:
        self.earlier = [*self.earlier[:1], *self.earlier[1:][-EARLIER + 1 :], self.model]
        self.model = model

    def recall(self, step: RecordedStep) -> None:
        """Take over what a recorded step says, without learning anew.

        In the place of a recorded model that cannot be used, the one before it stays in force.

        Raises:
            RecordingError: a step after which another model is in force than here.
            ModelError: the first model is of another kind, and cannot be this twin's.
        """
        experiment, told = step.experiment, step.adaptation
        model = self._recorded(step)
        if ROLLED_BACK in told.details and model is not None:
            self._roll_back(step, model)
            return
        if any(told.details.get(why) for why in PASSED_OVER):
            self._check_version(told)
            return
        if self.diagnoser is not None:
            self.diagnoser.recall(step)
            if step.diagnosis is not None and step.diagnosis.cause:
                self.named = step.diagnosis
        if step.signal.level is Level.WARNING:
            self.memory.store(experiment)
        elif step.signal.level is Level.POSITIVE:
            if told.details.get("warning_set"):  # no model could be trained: with more data it may
                self.memory.store(experiment)
            else:
                self.memory.clear()
        if model is not None:
            self._adopt(model)
        self.memory.remember(experiment)
        self._check_version(told)

    def _recorded(self, step: RecordedStep) -> Model | None:
        """The model that came into force after a step, if any."""
        if step.model is None:
            return None
        version = step.model.version
        try:
            model = self._restore(step.model)
            try_out(model, step.experiment)
        except ModelError as error:
            if not self.earlier and step.model.kind != self.model.kind:
                raise  # the first one already is another twin's
            self.unusable[version] = error
            return self.model.again(version)
        return model

    def _check_version(self, told: Adaptation) -> None:
        if self.model.version != told.model_version:
            where = f"adaptation of experiment {told.experiment}, model_version"
            raise RecordingError(where, str(self.model.version), told.model_version)

    def _roll_back(self, step: RecordedStep, model: Model) -> None:
        """Go on with an earlier model, as a person wanted it after this step.

        What was learned since it was adopted does not come back by itself: neither the later models
        nor the experiments kept, of which nobody knows which ones misled them.
        """
        if self.diagnoser is not None:
            self.diagnoser.recall(step)
        wanted = step.adaptation.details[ROLLED_BACK]
        self.earlier = [m for m in self.earlier if m.version < wanted]
        self.unusable = {v: why for v, why in self.unusable.items() if v < wanted}
        self.model, self.named = model, None
        self.memory.forget()
        self._check_version(step.adaptation)

    def _since(self, experiment: Experiment) -> int:
        """The first of the experiments in a row, up to the present one, that the model is of."""
        since = experiment.number
        for e in reversed(self.memory.recent):
            if e.number not in self.model.trained_on:
                break
            since = e.number
        return since

    def _pool(self, experiment: Experiment) -> list[Experiment]:
        """What to learn from at least, the present experiment last."""
        if self.data == "warning-set":
            pool = self.memory.union(experiment)
        else:
            pool = core(experiment, self._recent(experiment))
        # One model has one sample period: a machine whose period has changed is learned anew.
        return [e for e in pool if e.same_period(experiment)]

    def _recent(self, experiment: Experiment) -> list[Experiment]:
        return [e for e in self.memory.recent if e.same_period(experiment)]

    def _untried(self, learner: Model, pool: list[Experiment]) -> Offer:
        model = learner.fit(pool)
        origin = f"learned from {counted(len(pool), 'experiment')}"
        return Offer(model, origin, {"experiments": len(pool)})

    def _offer(self, learner: Model, pool: list[Experiment]) -> Offer:
        """The best by the gate: what the learner becomes, an earlier model or the present one."""
        # Judged by what neither the present model nor an earlier one can have learned from: an
        # experiment leaves S_w before it is learned from, but stays among the recent ones.
        evidence = self.data == "evidence"
        judged = pool[-1:] if evidence else pool
        recent = self._recent(judged[-1]) if evidence else []
        others = [e for e in recent if all(e is not p for p in pool)]
        return best_offer(self.model, self.earlier, learner, pool, judged, others, self.holdout)

    def state(self) -> dict[str, Any]:
        """Its state by the numbers of what is recorded; `return_to` takes it back."""
        return {
            "version": self.model.version,
            "earlier": [model.version for model in self.earlier],
            "named": self.named.experiment if self.named else None,
            "memory": self.memory.state(),
            "diagnoser": self.diagnoser.state() if self.diagnoser else None,
        }

    def return_to(self, state: Mapping[str, Any], archive: Archive) -> None:
        """Take back a state, before any step here.

        Raises:
            RecordingError: something that is not recorded; the adaptor is then as it was.
            ModelError: a recorded model that cannot be this machine's; the same.
            ValueError, TypeError, KeyError: no state; the same.
        """
        if len(state["earlier"]) > EARLIER + 1:
            raise ValueError("more models than are kept")
        first = self.model
        earlier = [first if v == first.version else archive.model(v) for v in state["earlier"]]
        present = state["version"]
        model = first if present == first.version else archive.model(present)
        named = None if state["named"] is None else archive.diagnosis(state["named"])
        memory = Memory(self.memory.limit, self.memory.history)
        memory.return_to(state["memory"], archive)
        if self.diagnoser is not None:
            self.diagnoser.return_to(state["diagnoser"], archive)
        self.model, self.memory, self.earlier, self.named = model, memory, earlier, named


def _figures(details: dict[str, float]) -> str:
    if "candidate_rmse" not in details:
        return ""
    tried, present = details["candidate_rmse"], details["present_rmse"]
    if tried == present:  # of an earlier model that is the present one over again
        return f"the same RMSE, {present:.4g} rad/s"
    return f"RMSE {tried:.4g} against {present:.4g} rad/s"
