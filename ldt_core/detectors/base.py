"""The protocol of all detectors: river's, with the paper's three answers on top."""

from __future__ import annotations

import abc
import inspect
from collections.abc import Mapping
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from ldt_core.errors import OptionError
from ldt_core.experiment import Level, Samples


class Detector(abc.ABC):
    """A drift detector that is updated once per experiment (paper, eq. 4).

    The constructor stores its arguments under their own names, checks them, and calls `reset`;
    all that changes afterwards is in `state()`, plain JSON. As in river, `update` returns nothing,
    `drift_detected` and `warning_detected` hold for the last update, and a detector that detected a
    drift starts anew by itself at the next update.
    """

    name: ClassVar[str]

    @abc.abstractmethod
    def reset(self) -> None:
        """Forget everything seen."""

    @abc.abstractmethod
    def judge(self, residual: Samples, deviation: Samples | None) -> Level:
        """The answer to one experiment; the place for the algorithm."""

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
            ValueError: residuals that are empty or not finite.
        """
        row = np.atleast_1d(np.asarray(residual, dtype=np.float64))
        if row.ndim != 1 or row.size == 0 or not np.isfinite(row).all():
            raise ValueError(f"residual: expected a finite row of samples, got shape {row.shape}")
        spread = None if deviation is None else np.atleast_1d(np.asarray(deviation, np.float64))
        if self.signal is Level.POSITIVE:
            self.reset()
        self.signal = self.judge(row, spread)

    #: Answer to the last experiment.
    signal: Level = Level.NEGATIVE

    @property
    def drift_detected(self) -> bool:
        """Whether the last experiment showed a drift (positive)."""
        return self.signal is Level.POSITIVE

    @property
    def warning_detected(self) -> bool:
        """Whether the last experiment gave a warning."""
        return self.signal is Level.WARNING

    @property
    def arguments(self) -> dict[str, Any]:
        """Constructor arguments by name."""
        names = list(inspect.signature(type(self)).parameters)
        return {name: getattr(self, name) for name in names}

    def clone(self) -> Self:
        """A new detector with the same arguments that has seen nothing."""
        return type(self)(**self.arguments)

    def state(self) -> dict[str, Any]:
        """All that changes, in JSON types; `restore` takes it back."""
        changing = {k: v for k, v in vars(self).items() if k not in self.arguments}
        return {k: int(v) if isinstance(v, Level) else v for k, v in changing.items()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state saved earlier.

        Raises:
            OptionError: the state is not this detector's.
        """
        self.reset()
        own = set(self.state()) | {"signal"}
        if not set(state) <= own:
            raise OptionError(f"state of {self.name}", f"keys {sorted(own)}", sorted(state))
        for key, value in state.items():
            setattr(self, key, Level(value) if key == "signal" else value)

    def __repr__(self) -> str:
        listed = ", ".join(f"{k}={v!r}" for k, v in self.arguments.items())
        return f"{type(self).__name__}({listed})"
