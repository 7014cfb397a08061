"""Any drift detector of the library river, behind the protocol of this project."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any

import numpy as np

from ldt_core.base.errors import OptionError, did_you_mean
from ldt_core.base.experiment import Level, Samples, rms
from ldt_core.detectors.base import Detector, declared

#: Values remembered so that a river detector can be rebuilt: about 1 MB as JSON.
MOST_VALUES = 50_000
#: Seed of those river detectors that draw random numbers and were given none.
SEED = 0

#: What a river detector is fed with: one value per experiment, or one per sample.
INPUTS = {
    "max_error": lambda residual, limit: [np.abs(residual).max()],
    "rmse": lambda residual, limit: [rms(residual)],
    "mean": lambda residual, limit: [np.mean(residual)],
    "error_rate": lambda residual, limit: [np.mean(np.abs(residual) > limit)],
    "residual": lambda residual, limit: residual,
    "absolute": lambda residual, limit: np.abs(residual),
    "errors": lambda residual, limit: np.abs(residual) > limit,
}


class River(Detector):
    """A detector of river, fed with the experiment's maximum error or another figure of it.

    Positive when river's detector detects a drift at any of the values of an experiment (the rest
    of the experiment is not fed), a warning when its warning stands at the experiment's end. After
    a positive a new one begins, as with every detector here; river's ADWIN alone would keep a part
    of its window. Where no new model came of it, it goes on as before that experiment. Mind that
    some look only now and then: with one value per experiment ADWIN wants `clock=1` and a small
    `grace_period`.

    River's detectors cannot be saved as JSON. The state is therefore what was fed since the last
    positive, and restoring it feeds it again, which gives the same detector to the last bit. To
    bound it, at `MOST_VALUES` values the older half is forgotten and the detector rebuilt from the
    younger; this happens in the running detector, so that a restart changes nothing. With one value
    per experiment it takes 50,000 experiments without a drift until then.

    Args:
        river_detector: name of a class in `river.drift` or `river.drift.binary`.
        input: max_error, rmse, mean, error_rate (one value per experiment); residual, absolute
            (every sample, [rad/s]); errors (every sample: further off than `error_threshold`?),
            which alone suits the binary detectors, and they alone suit it.
        error_threshold: for the inputs errors and error_rate [rad/s].
        river_arguments: for the constructor of river's class.

    Raises:
        OptionError: river is not installed, or an argument that it or its class refuses.

    Examples:
        >>> from ldt_core.detectors.river_adapter import River
        >>> detector = River("PageHinkley", min_instances=5, threshold=3.0)
        >>> for i, worst in enumerate([1.0] * 10 + [2.0] * 10, start=1):
        ...     detector.update([0.0, worst])
        ...     if detector.drift_detected:
        ...         print(i, detector.statistics)
        14 {'input': 2.0, 'values': 14}
    """

    name = "river"

    def __init__(
        self,
        river_detector: str = "ADWIN",
        input: str = "max_error",
        error_threshold: float = 1.0,
        **river_arguments: Any,
    ) -> None:
        self.river_detector = river_detector
        self.input = input
        self.error_threshold = declared("error_threshold", error_threshold)
        self.river_arguments = river_arguments
        if input not in INPUTS:
            raise OptionError("input", did_you_mean(str(input), INPUTS), repr(input))
        binary = _is_binary(_river_class(river_detector))
        if binary != (input == "errors"):
            expected = "'errors'" if binary else "any but 'errors'"
            raise OptionError(f"input of river's {river_detector}", expected, repr(input))
        self.reset()

    def get_params(self) -> dict[str, Any]:
        """Constructor arguments by name, river's among them."""
        own = {n: getattr(self, n) for n in ("river_detector", "input", "error_threshold")}
        return own | self.river_arguments

    def state(self) -> dict[str, Any]:
        """The values fed since the last positive, and the signal."""
        return {"values": list(self.values), "last": self.last, "signal": int(self.signal)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state saved earlier, by feeding it again.

        Raises:
            OptionError: the state is not this detector's; the detector then has seen nothing.
        """
        super().restore(state)
        if not all(type(v) in (int, float, bool) for v in self.values):
            self.reset()
            raise OptionError("state of detector river, values", "numbers", "something else")
        self._rebuild()

    def reset(self) -> None:
        """Begin a new river detector."""
        super().reset()
        self.values: list[float] = []
        #: Of these, from the last experiment.
        self.last = 0
        self._rebuild()

    def judge(self, residual: Samples, deviation: Samples | None) -> Level:
        """Feed the experiment's value or values; the deviation is not used."""
        row = INPUTS[self.input](residual, self.error_threshold)
        self.last = 0
        for value in np.asarray(row).tolist():
            if len(self.values) >= MOST_VALUES:
                self.values = self.values[MOST_VALUES // 2 :]
                self._rebuild()
            self.values.append(value)
            self.last += 1
            self._river.update(value)
            if self._river.drift_detected:
                return Level.POSITIVE
        warned = getattr(self._river, "warning_detected", False)
        return Level.WARNING if warned else Level.NEGATIVE

    def answered(self, adapted: bool) -> None:
        """Hear what came of a positive; without a new model the experiment does not count."""
        if not adapted:
            self.signal = Level.NEGATIVE
            del self.values[len(self.values) - self.last :]
            self.last = 0
            self._rebuild()

    @property
    def statistics(self) -> dict[str, float]:
        """The last value fed, and how many since the last positive."""
        return {"input": float(self.values[-1]), "values": len(self.values)} if self.values else {}

    def _rebuild(self) -> None:
        kind = _river_class(self.river_detector)
        arguments = dict(self.river_arguments)
        if "seed" in inspect.signature(kind).parameters:
            arguments.setdefault("seed", SEED)
        try:
            self._river = kind(**arguments)
        except (TypeError, ValueError) as error:
            signature = f"{kind.__name__}{inspect.signature(kind)}"
            raise OptionError("river_arguments", signature, f"{arguments} ({error})") from error
        for value in self.values:
            self._river.update(value)


def _river_class(name: str) -> type:
    try:
        from river import base, drift
    except ImportError as error:
        raise OptionError(
            "detector river", "the library river (pip install ldt[river])", str(error)
        ) from error
    known = {
        key: value
        for module in (drift, drift.binary)
        for key, value in vars(module).items()
        if isinstance(value, type)
        and issubclass(value, base.DriftDetector | base.BinaryDriftDetector)
    }
    if name not in known:
        raise OptionError("river_detector", did_you_mean(str(name), known), repr(name))
    return known[name]


def _is_binary(kind: type) -> bool:
    from river import base

    return issubclass(kind, base.BinaryDriftDetector)
