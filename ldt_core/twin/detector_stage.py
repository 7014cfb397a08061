"""Stage 2 of the loop: the detector's answer to each prediction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ldt_core.base.errors import ExperimentError, OptionError, RecordingError, reason_of
from ldt_core.base.experiment import (
    FAILED,
    NO_MEMORY,
    Experiment,
    Level,
    Prediction,
    Samples,
    Signal,
)
from ldt_core.base.own_process import undivided
from ldt_core.detectors import as_detector, build_detector
from ldt_core.detectors.adequacy import Adequacy
from ldt_core.detectors.base import Detector
from ldt_core.recording.status_messages import JUDGED_KEYS, SIGNAL_KEYS
from ldt_core.twin.stage import Archive, RecordedStep

#: Keys of a signal's message that are no statistic.
RESERVED = {*SIGNAL_KEYS, *JUDGED_KEYS} - {"max_error"}
#: In a state, beside the detector's own keys: version of the model judged last, and the assessor.
VERSION, ASSESSOR = "judged_version", "assessor"


class Assessor:
    """Says beside a detector that does not whether the model holds; it alarms nobody.

    Args:
        false_alarm_every: as for `Adequacy`.
    """

    def __init__(self, false_alarm_every: float = 1000.0) -> None:
        self.judge = Adequacy(false_alarm_every)

    def update(self, residual: Samples, deviation: Samples | None) -> None:
        """Take in one experiment, see `Detector.update`."""
        if self.judge.drift_detected:  # nobody has learned from it: what was found still stands
            limit = self.judge.false_alarm_every
            self.judge.misfit = min(self.judge.misfit, limit)
            self.judge.unexplained = min(self.judge.unexplained, limit)
            self.judge.signal = Level.NEGATIVE
        self.judge.update(residual, deviation)

    def answered(self, adapted: bool) -> None:
        """Hear that a new model has come into force, or that learning was tried in vain."""
        if adapted or self.judge.model_state in ("changed", "inadequate"):
            self.judge.answered(adapted)


class DetectorStage:
    """Stage 2: the detector compares prediction and measurement.

    Beside a detector that does not say whether the model holds an `Assessor` does.

    Args:
        name: the detector's name in the signal.
        detector: fresh or restored.
        assessor: None makes one, if the detector needs it.
    """

    def __init__(self, name: str, detector: Detector, assessor: Assessor | None = None) -> None:
        self.name = name
        self.detector = detector
        self.assessor = None if detector.model_state else assessor or Assessor()
        #: Version of the model whose prediction was judged last.
        self._version: int | None = None
        #: Why the detector failed at the last experiment, "" if it did not.
        self.trouble = ""
        self._statistics: dict[str, float] = {}  # of the last answer
        self._lacks = False  # whether it recalled a recording that lacks some of what was judged

    def step(self, experiment: Experiment, prediction: Prediction) -> Signal:
        """The signal for one experiment: a warning that says so where the detector fails.

        Raises:
            ExperimentError: experiment and prediction do not belong together.
        """
        if not self._judged(experiment, prediction):
            return Signal(
                experiment.number,
                Level.WARNING,
                self.name,
                prediction.model_version,
                prediction.max_error(experiment),
                self._statistics,
                "learning",  # too little is known to judge
            )
        judge = self.detector
        if self.assessor is not None and not judge.model_state:
            judge = self.assessor.judge
        return Signal(
            experiment.number,
            self.detector.signal,
            self.name,
            prediction.model_version,
            prediction.max_error(experiment),
            self._statistics,
            judge.model_state,
            judge.adequacy,
        )

    def recall(self, step: RecordedStep) -> None:
        """Update the detector as in a recorded step.

        Behind a gap it cannot come to the same answers: those recorded count.

        Raises:
            RecordingError: this detector answers otherwise than the recorded one.
        """
        judged = self._judged(step.experiment, step.prediction, step.signal)
        recorded, answer = step.signal.level, self.detector.signal
        if not judged:
            answer = Level.WARNING
        self._lacks |= step.behind_gap
        if step.signal.detector != self.name or (answer is not recorded and not self._lacks):
            raise RecordingError(
                f"signal of experiment {step.experiment.number}",
                f"{recorded.word!r} by the detector {step.signal.detector}, as recorded",
                f"{answer.word!r} by {self.name}, as of another version or where chance decides "
                "(ldt run --play RECORDING begins anew on what is recorded)",
            )

    def state(self) -> dict[str, Any] | None:
        """The detector's state; None where that may not be all of it (`Detector.resumable`)."""
        own = vars(type(self.detector)).get("resumable", False)
        if not own:
            return None
        beside = {} if self.assessor is None else {ASSESSOR: self.assessor.judge.state()}
        return {**self.detector.state(), VERSION: self._version, **beside}

    def return_to(self, state: Mapping[str, Any], archive: Archive) -> None:
        """Restore the detector.

        Raises:
            OptionError: no state of this detector, which then has seen nothing.
        """
        own = dict(state)
        version = own.pop(VERSION, None)
        if version is not None and (type(version) is not int or version < 0):
            raise ValueError(f"{VERSION} {version!r}")
        if self.assessor is not None:
            if ASSESSOR not in own:
                expected = f"the keys of the detector and {ASSESSOR!r}"
                raise OptionError(f"state of detector {self.name}", expected, sorted(own))
            self.assessor.judge.restore(own.pop(ASSESSOR))
        try:
            self.detector.restore(own)
        except OptionError:
            if self.assessor is not None:
                self.assessor.judge.reset()
            raise
        self._version = version

    @undivided()
    def _judged(
        self, experiment: Experiment, prediction: Prediction, said: Signal | None = None
    ) -> bool:
        """Take in one experiment; False where the detector fails, which costs it this one alone."""
        try:
            self._update(experiment, prediction, said)
            self._statistics = _plain(self.detector.statistics)
        except (ExperimentError, KeyboardInterrupt):
            raise
        except BaseException as error:  # of a detector of the user's own, for one
            self.trouble = f"experiment {experiment.number}: {reason_of(error)}"
            self._statistics = {FAILED: 1.0}
            if isinstance(error, MemoryError):
                self._statistics[NO_MEMORY] = 1.0
            return False
        self.trouble = ""
        return True

    def _update(self, experiment: Experiment, prediction: Prediction, said: Signal | None) -> None:
        adapted = prediction.model_version != self._version
        heard = self.detector.drift_detected
        # A version can come into force at a warning, too.
        if self._version is not None and (heard or adapted):
            self.detector.answered(adapted)
            if self.assessor is not None:
                self.assessor.answered(adapted)
        self._version = prediction.model_version
        residual, deviation = prediction.residual(experiment), prediction.speed_std
        mine = said is not None and self.assessor is None and self.name == said.detector
        if said is not None and mine and self.detector.take_over(said, experiment, deviation):
            return
        self.detector.excited(experiment.voltage)
        self.detector.measured(experiment.speed)
        self.detector.update(residual, deviation)
        if self.assessor is not None:
            self.assessor.judge.excited(experiment.voltage)
            self.assessor.judge.measured(experiment.speed)
            self.assessor.update(residual, deviation)


def _plain(statistics: Mapping[str, float]) -> dict[str, float]:
    """Figures that a signal can carry beside its own; every signal has the maximum error.

    Raises:
        TypeError, ValueError, KeyError: a detector of the user's own has others.
    """
    found = {}
    for name, value in statistics.items():
        if not isinstance(name, str) or name in RESERVED:
            raise KeyError(f"a statistic named {name!r}")
        if name != "max_error":
            found[name] = float(value)
    return found


def as_detector_stage(detector: object, settings: Mapping[str, Any]) -> DetectorStage:
    """Stage 2 of a detector: name, class or object; None takes that of the settings."""
    if isinstance(detector, DetectorStage):
        return detector
    if detector is None or isinstance(detector, str):
        return build_detector_stage(settings)
    built = (
        build_detector(detector, settings)
        if isinstance(detector, type) and issubclass(detector, Detector)
        else as_detector(detector)
    )
    name = getattr(built, "name", type(built).__name__)
    return DetectorStage(name, built, Assessor(settings["false_alarm_every"]))


def build_detector_stage(settings: Mapping[str, Any]) -> DetectorStage:
    """Stage 2 from the parameters of the group detector."""
    built = build_detector(settings["detector"], settings)
    return DetectorStage(settings["detector"], built, Assessor(settings["false_alarm_every"]))
