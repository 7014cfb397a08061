"""Stage 2 of the loop: the detector's answer to each prediction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ldt_core.base.errors import RecordingError
from ldt_core.base.experiment import Experiment, Prediction, Signal
from ldt_core.detectors import as_detector, build_detector
from ldt_core.detectors.base import Detector
from ldt_core.twin.stage import Archive, RecordedStep

#: In a state, beside the detector's own keys: version of the model judged last.
VERSION = "judged_version"


class DetectorStage:
    """Stage 2: the detector compares prediction and measurement.

    Args:
        name: the detector's name in the signal.
        detector: fresh or restored.
    """

    def __init__(self, name: str, detector: Detector) -> None:
        self.name = name
        self.detector = detector
        #: Version of the model whose prediction was judged last.
        self._version: int | None = None

    def step(self, experiment: Experiment, prediction: Prediction) -> Signal:
        """The signal for one experiment.

        Raises:
            ExperimentError: experiment and prediction do not belong together.
        """
        self._update(experiment, prediction)
        statistics = dict(self.detector.statistics)
        statistics.pop("max_error", None)  # every signal has it
        return Signal(
            experiment.number,
            self.detector.signal,
            self.name,
            prediction.model_version,
            prediction.max_error(experiment),
            statistics,
            self.detector.model_state,
            self.detector.adequacy,
        )

    def recall(self, step: RecordedStep) -> None:
        """Update the detector as in a recorded step.

        Raises:
            RecordingError: this detector answers otherwise than the recorded one.
        """
        self._update(step.experiment, step.prediction)
        recorded, answer = step.signal.level, self.detector.signal
        if step.signal.detector != self.name or answer is not recorded:
            raise RecordingError(
                f"signal of experiment {step.experiment.number}",
                f"{recorded.word!r} by the detector {step.signal.detector}, as recorded",
                f"{answer.word!r} by {self.name}",
            )

    def state(self) -> dict[str, Any] | None:
        """The detector's state; None where that may not be all of it (`Detector.resumable`)."""
        own = vars(type(self.detector)).get("resumable", False)
        return {**self.detector.state(), VERSION: self._version} if own else None

    def return_to(self, state: Mapping[str, Any], archive: Archive) -> None:
        """Restore the detector.

        Raises:
            OptionError: no state of this detector, which then has seen nothing.
        """
        own = dict(state)
        version = own.pop(VERSION, None)
        if version is not None and (type(version) is not int or version < 0):
            raise ValueError(f"{VERSION} {version!r}")
        self.detector.restore(own)
        self._version = version

    def _update(self, experiment: Experiment, prediction: Prediction) -> None:
        if self.detector.drift_detected and self._version is not None:
            self.detector.answered(prediction.model_version != self._version)
        self._version = prediction.model_version
        self.detector.update(prediction.residual(experiment), prediction.speed_std)


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
    return DetectorStage(getattr(built, "name", type(built).__name__), built)


def build_detector_stage(settings: Mapping[str, Any]) -> DetectorStage:
    """Stage 2 from the parameters of the group detector."""
    return DetectorStage(settings["detector"], build_detector(settings["detector"], settings))
