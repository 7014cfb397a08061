"""How far a residual is from noise: an e-value for noise of any law, and its size.

Noise that is independent from sample to sample and symmetric about zero has random signs: given
the magnitudes, every product of neighbours is as often positive as negative. What a model leaves
lasts for more than one sample, and makes these products positive.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.arrays import Array
from ldt_core.estimation.noise import roughness

#: Variance that a model may leave beyond the noise, as a part of the noise's, and still explain an
#: experiment: with 0.2 a prediction is at most 10 % worse than the best there can be.
TOLERATED = 0.2
#: What a model claims not to know is believed up to so many of its standard deviations.
BELIEVED = 3.0
#: Sizes, in standard deviations, of the misfits that the e-value is sensitive to.
SIZES = (1.0, 2.0, 4.0, 8.0)
_SIZES = np.array(SIZES)[:, np.newaxis]
_HALVES = _SIZES * _SIZES / 2
#: Samples of the shortest stretch that is looked at by itself: its e-value can reach 5e6.
STRETCH = 32
#: e-value up to which a model explains an experiment: at most one true model in 740 does not, as
#: beyond three standard deviations (Markov's inequality).
EXPLAINED = 740.0
#: Two neighbours beyond so many deviations of the noise on one side are no noise of any usual law.
FAR = 10.0
#: Roughness [of the residual's largest value] below which it is rounding and no noise.
ROUNDING = 1e-9
#: Mean square [(rad/s)^2] of a residual that vanishes altogether; a division by it is a number.
LEAST_SQUARE = 1e-200
#: Largest logarithm of an e-value: sums and products of two are still numbers.
MOST_LOG = 300.0


@dataclass(frozen=True)
class Misfit:
    """What one experiment says of its model.

    Attributes:
        evidence: e-value, mean at most 1 if the residual is independent symmetric noise.
        excess: products of neighbours in their standard deviations, beyond what is tolerated.
        ratio: root mean square residual over the noise alone.
        relative: the same over noise and claim.
        far: whether neighbours lie together beyond `FAR` deviations of the noise.
    """

    evidence: float
    excess: float
    ratio: float
    relative: float
    far: bool

    @property
    def explained(self) -> bool:
        """Whether the model explains the experiment."""
        return self.evidence < EXPLAINED and not self.far


@functools.lru_cache(maxsize=64)
def _edges(length: int, count: int) -> NDArray[np.int64]:
    """Where so many stretches of a row begin."""
    return np.linspace(0, length, count, endpoint=False).astype(np.int64)


def misfit(residual: Array, deviation: Array | None = None) -> Misfit:
    """What a residual says of the model that left it.

    The e-value is a mean over the run, its halves, quarters ..., and over `SIZES` m, of
    exp(m S / sqrt(V) - m^2 / 2), with S the sum and V the sum of squares of a stretch's products of
    neighbours. Its mean is at most 1: given the magnitudes, the products' signs are independent and
    fair, and cosh u <= exp(u^2 / 2) (de la Pena, Lai, Shao, "Self-normalized processes", 2009,
    section 2.2). S is lessened by the tolerated misfit, and samples of which the model claims to
    know less count less: so many of its deviations as are believed come to the tolerated misfit.

    Args:
        residual: (L,) measured minus predicted, L >= 2.
        deviation: (L,) the model's predictive standard deviation; its least is the noise's.
    """
    floor = ROUNDING * float(np.abs(residual).max())
    noise = max(roughness(residual) ** 2, floor**2, LEAST_SQUARE)
    scaled = residual / math.sqrt(noise)
    square = np.square(scaled)
    row, relative = scaled, square
    if deviation is not None:
        claimed = (deviation**2 - float(np.min(deviation)) ** 2) / noise
        row = scaled * (1.0 / np.sqrt(1.0 + BELIEVED**2 / TOLERATED * claimed))
        relative = square / (1.0 + claimed)
    products = row[:-1] * row[1:]
    surplus, squares = products - TOLERATED, np.square(products)
    levels = []
    excess = 0.0
    count = 1
    while count == 1 or products.size // count >= STRETCH:
        edges = _edges(products.size, count)
        above = np.add.reduceat(surplus, edges)
        spread = np.sqrt(np.add.reduceat(squares, edges))
        z = above / np.maximum(spread, 1e-150)
        if count == 1:
            excess = float(z[0])
        powers = _SIZES * z - _HALVES
        levels.append(float(np.mean(np.exp(np.minimum(powers, MOST_LOG)))))
        count *= 2
    return Misfit(
        float(np.mean(levels)),
        excess,
        math.sqrt(float(np.mean(square))),
        math.sqrt(float(np.mean(relative))),
        bool(np.max(scaled[:-1] * scaled[1:]) > FAR**2),
    )
