"""The protocol of all detectors: river's, with the paper's three answers on top."""

from __future__ import annotations

import abc
import copy
import inspect
import json
from collections.abc import Mapping
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

import msgs_config
from ldt_core.base.errors import OptionError
from ldt_core.base.experiment import Experiment, Level, Samples, Signal
from ldt_core.base.settings import check


class Detector(abc.ABC):
    """A drift detector that is updated once per experiment (paper, eq. 4).

    To write one, define two methods besides `judge`, which answers for one experiment. The
    constructor stores its arguments under their own names, checks them, and calls `reset`. `reset`
    calls the base's and sets all that changes, in JSON types; what is derived from it has a leading
    underscore. `ldt_core.checks.check_detector` tests whether it keeps the promises of this class.

    As in river, `update` returns nothing, and `drift_detected` and `warning_detected` are about the
    last update. After a drift, a detector restarts by itself at the next update. One that learns
    what is usual does not restart if no new model resulted (`answered`). Otherwise it would take
    the changed machine for usual.
    """

    name: ClassVar[str]
    #: Whether it can answer with a warning.
    warns: ClassVar[bool] = True
    #: Whether the order of the samples inside an experiment does not matter to it.
    order_free: ClassVar[bool] = False
    #: Whether `state` is all that decides its answers, to the last bit, so that a twin that is
    #: started again may go on from it. Said by each class for itself, not for those derived of it.
    resumable: ClassVar[bool] = False
    #: Answer to the last experiment.
    signal: Level
    #: What is known of machine and model, and the residual over the noise, see `Signal`; for
    #: detectors that judge them.
    model_state: str = ""
    adequacy: float | None = None

    def reset(self) -> None:
        """Forget everything seen; a detector with a state of its own calls this from its own."""
        self.signal = Level.NEGATIVE

    def restart(self) -> None:
        """Start anew after a positive."""
        self.reset()

    @abc.abstractmethod
    def judge(self, residual: Samples, deviation: Samples | None) -> Level:
        """The answer to one experiment; the place for the algorithm.

        Args:
            residual: (L,) measured minus predicted [rad/s], finite.
            deviation: (L,) the model's own predictive standard deviation [rad/s], or None.
        """

    @property
    def statistics(self) -> dict[str, float]:
        """What was compared at the last update: the statistic and its limits, by name."""
        return {}

    def update(self, residual: ArrayLike, deviation: ArrayLike | None = None) -> None:
        """Take in one experiment.

        Args:
            residual: (L,) measured minus predicted [rad/s]; a scalar counts as one sample.
            deviation: (L,) the model's own predictive standard deviation [rad/s], or None.

        Raises:
            ValueError: residuals that are empty or not finite, or deviations of another shape.
        """
        row = np.atleast_1d(np.asarray(residual, dtype=np.float64))
        if row.ndim != 1 or row.size == 0:
            raise ValueError(f"residual: expected a row of samples, got shape {row.shape}")
        if not np.isfinite(row).all():
            at = int(np.argmin(np.isfinite(row)))
            raise ValueError(f"residual: expected finite samples, got {row[at]} at sample {at}")
        spread = None if deviation is None else np.atleast_1d(np.asarray(deviation, np.float64))
        if spread is not None and spread.shape != row.shape:
            raise ValueError(f"deviation: expected shape {row.shape}, got {spread.shape}")
        if self.signal is Level.POSITIVE:
            self.restart()
        self.signal = Level(self.judge(row, spread))

    def answered(self, adapted: bool) -> None:  # noqa: B027 - not all need to know
        """Take note of what followed a positive, before the next update.

        Args:
            adapted: whether a new model took over; else the old one stayed. A detector that
                learns what is usual forgets the experiment then, and sets `signal` to negative, so
                that `update` does not start anew.
        """

    def excited(self, voltage: Samples) -> None:  # noqa: B027 - most detectors need not know
        """Take note of the voltage (L,) [V] of the experiment that the next update is about."""

    def measured(self, speed: Samples) -> None:  # noqa: B027 - most detectors need not know
        """Take note of the measured speed (L,) [rad/s] of the experiment to be judged next."""

    def take_over(self, signal: Signal, experiment: Experiment, deviation: Samples | None) -> bool:
        """Take over a recorded signal about an experiment, instead of `update`.

        For detectors whose signal tells all that `update` would find out, to the last bit.

        Args:
            signal: as it was recorded.
            experiment: that it was about.
            deviation: (L,) the model's own predictive standard deviation [rad/s], or None.

        Returns:
            Whether it is as after `update`; else nothing has changed, and `update` decides.
        """
        return False

    @property
    def drift_detected(self) -> bool:
        """Whether the last experiment showed a drift (positive)."""
        return self.signal is Level.POSITIVE

    @property
    def warning_detected(self) -> bool:
        """Whether the last experiment gave a warning."""
        return self.signal is Level.WARNING

    def get_params(self) -> dict[str, Any]:
        """Constructor arguments by name, as scikit-learn's estimators give them."""
        names = list(inspect.signature(type(self)).parameters)
        return {name: getattr(self, name) for name in names}

    def clone(self) -> Self:
        """A new detector with the same arguments that has seen nothing."""
        return type(self)(**self.get_params())

    def state(self) -> dict[str, Any]:
        """All that changes, in JSON types; `restore` takes it back."""
        fixed = self.get_params()
        changing = {k: v for k, v in vars(self).items() if k not in fixed and k[0] != "_"}
        return copy.deepcopy({**changing, "signal": int(self.signal)})

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state saved earlier by a detector with the same arguments.

        Raises:
            OptionError: the state is not this detector's; the detector then has seen nothing.
        """
        self.reset()
        where, own = f"state of detector {self.name}", self.state()
        if not isinstance(state, Mapping) or set(state) != set(own):
            got = sorted(state) if isinstance(state, Mapping) else type(state).__name__
            raise OptionError(where, f"the keys {sorted(own)}", got)
        for key, value in state.items():
            if not _fits(value, own[key]):
                raise OptionError(f"{where}, {key}", f"the like of {own[key]!r}", repr(value))
        if state["signal"] not in list(Level):
            raise OptionError(f"{where}, signal", "-1, 0 or 1", state["signal"])
        for key, value in state.items():
            setattr(self, key, Level(value) if key == "signal" else copy.deepcopy(value))

    def __repr__(self) -> str:
        listed = ", ".join(f"{k}={v!r}" for k, v in self.get_params().items())
        return f"{type(self).__name__}({listed})"


def declared(name: str, value: Any) -> Any:
    """A constructor argument, checked by its declaration in `parameters.yaml`.

    Raises:
        OptionError: a wrong type, or a value outside the declared range.
    """
    return check(name, value, msgs_config.parameters("detector")[name])


def _fits(value: Any, fresh: Any) -> bool:
    """Whether a stored value is finite JSON of the kind a fresh detector has there."""
    try:
        json.dumps(value, allow_nan=False)
    except (TypeError, ValueError, RecursionError):
        return False
    if fresh is None:  # not known yet: a number, once it is
        return value is None or _kind(value) is float
    return _kind(value) is _kind(fresh)


def _kind(value: Any) -> type:
    return float if type(value) in (int, float) else type(value)
