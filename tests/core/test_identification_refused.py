"""Experiments that determine no linear model are refused, each kind with its own sentence."""

from __future__ import annotations

import numpy as np
import pytest

from ldt_core.base.errors import ExperimentError, LdtError, OptionError
from ldt_core.base.experiment import Experiment
from ldt_core.estimation.linear import identify

PERIOD = 0.01  # s


def noise(seed: int, samples: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=samples)


def lively(number: int = 1, samples: int = 2000, period: float = PERIOD) -> Experiment:
    """A machine of first order under a voltage that changes every few samples: nothing wrong."""
    voltage = np.repeat(noise(number, samples // 5 + 1), 5)[:samples]
    speed = np.zeros(samples)
    for k in range(1, samples):
        speed[k] = 0.9 * speed[k - 1] + 0.3 * voltage[k - 1]
    return Experiment(number, 0.0, period, voltage, speed)


def flat(number: int, volts: float, period: float = PERIOD, samples: int = 500) -> Experiment:
    speed = 3 * volts + noise(number, samples)
    return Experiment(number, 0.0, period, np.full(samples, volts), speed)


def stopped() -> Experiment:
    return Experiment(1, 0.0, PERIOD, lively().voltage, np.zeros(2000))


def deaf() -> Experiment:
    return Experiment(1, 0.0, PERIOD, lively().voltage, noise(0, 2000))


def late() -> Experiment:
    voltage = np.zeros(500)
    voltage[-1] = 5.0
    return Experiment(1, 0.0, PERIOD, voltage, noise(0, 500))


REFUSED = {
    "none": (lambda: identify([]), ExperimentError, "at least one experiment"),
    "constant voltage": (lambda: identify([flat(1, 5.0)]), LdtError, "voltage is 5 V throughout"),
    "too simple": (
        lambda: identify([flat(1, 5.0), flat(2, 9.0)], 2),
        LdtError,
        "varies too little or too simply",
    ),
    "voltage after the fact": (lambda: identify([late()]), LdtError, "too little or too simply"),
    "speed stands": (lambda: identify([stopped()]), LdtError, "speed is 0 rad/s throughout"),
    "no effect": (lambda: identify([deaf()]), LdtError, "no more of the speed than chance"),
    "few samples": (
        lambda: identify([lively(samples=12)]),
        LdtError,
        "12 samples for 4 unknowns",
    ),
    "few for the order": (
        lambda: identify([lively(samples=40)], 5),
        LdtError,
        "40 samples for 16 unknowns",
    ),
    "periods": (
        lambda: identify([lively(), lively(2, period=0.02)]),
        ExperimentError,
        "experiment 2, sample period: expected 0.01 s as in experiment 1",
    ),
    "order": (lambda: identify([lively()], 11), OptionError, "from 0 to 10"),
}


@pytest.mark.parametrize(("work", "kind", "sentence"), REFUSED.values(), ids=REFUSED)
def test_data_that_determine_nothing_are_refused(work, kind, sentence):
    """Each kind of unusable data has its own sentence."""
    with pytest.raises(kind) as caught:
        work()
    assert sentence in str(caught.value)
