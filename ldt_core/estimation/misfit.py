"""How far a residual is from noise: an e-value for noise of any law, and its size.

Noise that is independent from sample to sample and symmetric about zero has random signs: given
the magnitudes, every product of neighbours is as often positive as negative. What a model leaves
lasts for more than one sample, and makes these products positive. What lasts for less than a sample
period follows the voltage: noise knows nothing of it, and its signs agree with the voltage's last
steps as often as not. What swings within three to six samples makes the products of samples two
apart negative, and what comes in blows is far out for some samples in a row, whatever their signs.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.arrays import Array
from ldt_core.estimation.far_samples import (
    FAR,
    LARGE_STEP,
    MOST_LOG,
    ROUNDING,
    far_behind_steps,
    in_blows,
    outliers,
)
from ldt_core.estimation.noise import (
    NORMAL_MEDIAN,
    ROUGHER,
    noise_beside_steps,
    roughness,
    sensor_step,
)
from ldt_core.estimation.noise import ROUNDING as ROUNDED

#: Variance that a model may leave beyond the noise, as a part of the noise's, and still explain an
#: experiment: with 0.2 a prediction is at most 10 % worse than the best there can be.
TOLERATED = 0.2
#: The same of samples two apart with opposite signs: as much as noise has in a speed which central
#: differences take from an angle with white noise.
TOLERATED_SWING = 0.5
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
#: Variance of an error that is clearly more than the noise, as a part of the noise's: as large.
#: With 0.5, a true model is doubted in a third of the experiments of 20 samples, not in a tenth;
#: with 2, a motor with experiments of 50 samples leaves a fifth more of the error.
CLEAR = 1.0
#: Deviations of chance: beyond three a true model does not explain, as above; two are the usual
#: doubt whether an experiment tells enough.
BY_CHANCE, DOUBT = 3.0, 2.0
#: Bets on the sign of a sample of `FAR` deviations: what is won or lost, of what one has.
BETS = (-0.9, -0.5, 0.5, 0.9)
#: Samples up to which a swing near half the sample rate is asked whether it remembers itself, and
#: deviations of their products' sum that fair signs exceed at one of these once in a million.
LAGS = 8
REMEMBERED = math.sqrt(2 * math.log(2e6 * LAGS))
#: Noise [of a sensor's step] from which on its rounding is white: half a step of noise, and with it
#: the rounding's own deviation.
NOISY = math.sqrt(0.25 + ROUNDED**2)
#: Mean square [(rad/s)^2] of a residual that vanishes altogether; a division by it is a number.
LEAST_SQUARE = 1e-200
#: Part of an error in the first sample below which what is left of it tells nothing.
LEAST_LEFT = 1e-3
LEAST_MOVE = 1e-150  # V; what follows less would be told in numbers beyond floating point


@dataclass(frozen=True)
class Misfit:
    """What one experiment says of its model.

    Attributes:
        evidence: e-value, mean at most 1 if the residual is independent symmetric noise.
        excess: products of neighbours in their standard deviations, beyond what is tolerated.
        ratio: root mean square residual over the noise alone.
        relative: the same over noise and claim.
        error: variance of what lasts for more than a sample, as a part of the noise's.
        chance: standard deviation of that under noise of one size, whatever its law.
        far: whether neighbours lie together beyond `FAR` deviations of the noise, or most samples
            behind the voltage's large steps do, or far samples closer together than by chance, or
            all is louder than noise may be and remembers itself.
        noise: its deviation, in the unit of the residual.
        outliers: samples beyond `FAR` deviations as nine of ten show them.
        outlier_odds: e-value of bets that they lie close behind the voltage's steps.
    """

    evidence: float
    excess: float
    ratio: float
    relative: float
    error: float
    chance: float
    far: bool
    noise: float
    outliers: int
    outlier_odds: float

    @property
    def explained(self) -> bool:
        """Whether the model explains the experiment.

        The e-value holds for noise of any law, and so finds nothing in few samples, however large
        the error. There its size counts.
        """
        clear = self.error > CLEAR + BY_CHANCE * self.chance
        return self.evidence < EXPLAINED and not self.far and not clear

    @property
    def small(self) -> bool:
        """Whether there are samples enough to say that the error is not clearly more than noise."""
        return self.error + DOUBT * self.chance < CLEAR


@functools.lru_cache(maxsize=64)
def _edges(length: int, count: int) -> NDArray[np.int64]:
    """Where so many stretches of a row begin."""
    return np.linspace(0, length, count, endpoint=False).astype(np.int64)


@dataclass(frozen=True, eq=False)
class Setting:
    """What the samples of an experiment were measured under.

    Attributes:
        moves: (L, 3) what moves a machine faster than its sample period: the last voltage and two
            steps. Row k holds what has acted before sample k: its noise can have come into no
            voltage there, of a closed loop neither.
        slack: (L,) how far a coarse sensor alone may take a sample [rad/s].
        quiet: deviation of the measured speed's own noise [rad/s], which no model's error is in; 0
            where it is not known, infinite where blows are to tell nothing. A fast motion makes it
            larger.
        start: (L,) what is left of an error in the first sample, as a part of it; 0 where a
            prediction does not begin there.
        most: deviation that noise may have [rad/s]; what is rougher and remembers itself is none.
    """

    moves: Array
    slack: Array
    start: Array
    quiet: float = 0.0
    most: float = math.inf

    @property
    def resolved(self) -> float:
        """Deviation of what a coarse sensor rounds off [rad/s]; 0 of a fine one."""
        return float(self.slack.max(initial=0.0)) * 2 * ROUNDED

    def part(self, which: NDArray[np.bool_] | slice, unit: float = 1.0) -> Setting:
        """That of some samples, in a unit of the speed [rad/s]."""
        slack, quiet, most = self.slack[which] / unit, self.quiet / unit, self.most / unit
        return Setting(self.moves[which], slack, self.start[which], quiet, most)


def setting(
    voltage: Array,
    speed: Array | None = None,
    step: float = 0.0,
    predicted: Array | None = None,
    most: float = math.inf,
) -> Setting:
    """What the samples of an experiment were measured under.

    Rounding is white where the signal passes a step, or noise carries it over half of one, from
    sample to sample. Where a sensor with steps shows a value again, that says no more than that the
    speed lies within half a step.

    Args:
        voltage: (L,) [V], each held from its sample to the next.
        speed: (L,) as measured [rad/s]; None where it is not known.
        step: of the sensor [rad/s], where this speed shows none; 0 where it is not known.
        predicted: (L,) [rad/s] from the first measured sample on; None where that is not known.
        most: as of `Setting`.
    """
    before = np.concatenate([np.zeros(3), voltage])[:-1]
    before[:3] = voltage[0]
    change = np.diff(before)
    moves = np.column_stack([before[2:], change[1:], change[:-1]])
    moves[np.abs(moves) < LEAST_MOVE] = 0.0
    slack = np.zeros(voltage.size)
    step = step if speed is None else sensor_step([speed]) or step
    quiet = 0.0 if speed is None else noise_beside_steps([speed], step)
    if speed is not None and step > 0 and quiet < NOISY * step:
        again = np.diff(speed) == 0
        slack[1:][again] = step / 2
        slack[:-1][again] = step / 2
    start = np.zeros(voltage.size) if predicted is None else _left_of_start(voltage, predicted)
    return Setting(moves, slack, start, quiet, most)


def _left_of_start(voltage: Array, predicted: Array) -> Array:
    """(L,) what the machine of a prediction remembers of its first speed, as a part of it.

    A prediction has no noise: how it follows the voltage shows what it forgets from one sample to
    the next, to first order.
    """
    before = np.column_stack([predicted, voltage, np.ones(voltage.size)])[:-1]
    if predicted.size <= 2 * before.shape[1] or not np.ptp(predicted) > 0:
        return np.zeros(predicted.size)
    kept = float(np.linalg.lstsq(before, predicted[1:], rcond=None)[0][0])
    return np.asarray(min(max(kept, 0.0), 1.0) ** np.arange(predicted.size))


def _without_start(residual: Array, start: Array) -> Array:
    """What noise in the first sample has not made of a residual (L,), in its unit.

    The least absolute deviation, which outliers do not move, no larger than the other samples'
    noise: the first one's is exchangeable with theirs, and larger than all of it one time in L.
    """
    told = start > LEAST_LEFT
    if np.count_nonzero(told) < 4:
        return residual
    alone = np.abs(np.diff(residual[1:]))
    most = float(np.max(np.minimum(alone[1:], alone[:-1])))  # one step there, and one back
    each = residual[told] / start[told]
    order = np.argsort(each)
    weight = np.cumsum(start[told][order])
    offset = float(each[order][np.searchsorted(weight, weight[-1] / 2)])
    return np.asarray(residual - min(max(offset, -most), most) * start)


def noise_in(residual: Array, under: Setting | None) -> float:
    """Deviation of the noise in a residual (L,), in its unit: what is rough and follows nothing.

    Not less than what a sensor rounds off.
    """
    if under is None:
        return roughness(residual)
    least = under.resolved
    moves = under.moves
    if residual.size <= 2 * moves.shape[1]:
        return max(roughness(residual), least)
    followed = moves @ np.linalg.lstsq(moves, residual, rcond=None)[0]
    wider = math.sqrt(1 + moves.shape[1] / residual.size)
    # The best fit to a slow error may jump where the voltage does, and so be rougher than it.
    rough = min(roughness(residual - followed) * wider, roughness(residual))
    return max(rough, least)


def misfit(residual: Array, deviation: Array | None = None, under: Setting | None = None) -> Misfit:
    """What a residual says of the model that left it.

    The e-value is a mean over the run, its halves, quarters ..., and over `SIZES` m, of
    exp(m S / sqrt(V) - m^2 / 2), with S the sum and V the sum of squares of a stretch's products of
    neighbours. Its mean is at most 1: given the magnitudes, the products' signs are independent and
    fair, and cosh u <= exp(u^2 / 2) (de la Pena, Lai, Shao, "Self-normalized processes", 2009,
    section 2.2). S is lessened by the tolerated misfit, and samples of which the model claims to
    know less count less: so many of its deviations as are believed come to the tolerated misfit.

    With a setting a quarter of it is the same of samples two apart, with the other sign. Another
    quarter is a mean over bets b on the sign of each sample times what has moved the machine:
    prod(1 + b s_k), s_k that product in parts of its largest. Given all sizes, of which the median
    is the unit, the signs are fair, and each factor has the mean 1. It is divided by what the
    tolerated misfit would win. What follows the movements does not count as noise. What a coarse
    sensor may have rounded off is taken off beforehand, and what noise in the first sample may have
    made of a prediction that begins there: one unknown, fitted, no larger than the noise.

    It is multiplied by the e-value of how close together the samples far out lie. That has a mean
    of 1 where the sizes come in any order equally likely; as all the rest has, given that order.
    What is rougher than noise may be and remembers itself is none: a swing near half the rate.

    Args:
        residual: (L,) measured minus predicted, L >= 2.
        deviation: (L,) the model's predictive standard deviation; its least is the noise's.
        under: its setting; None where nothing of it is known.
    """
    if under is not None:
        residual = _without_start(residual, under.start)
    floor = ROUNDING * float(np.abs(residual).max())
    rough = noise_in(residual, under)
    most = math.inf if under is None else under.most
    loud = rough > max(most, floor) and _remembers(residual)
    noise = max((most / ROUGHER if loud else rough) ** 2, floor**2, LEAST_SQUARE)
    scaled = residual / math.sqrt(noise)
    square = np.square(scaled)
    told = scaled
    if under is not None and under.slack.any():
        told = residual - np.clip(residual, -under.slack, under.slack)
        told /= math.sqrt(noise)
    row, relative, claimed = told, square, np.zeros(1)
    if deviation is not None:
        claimed = (deviation**2 - float(np.min(deviation)) ** 2) / noise
        row = told * (1.0 / np.sqrt(1.0 + BELIEVED**2 / TOLERATED * claimed))
        relative = square / (1.0 + claimed)
    products = row[:-1] * row[1:]
    evidence, excess = _signed(products, TOLERATED)
    far = bool(np.max(told[:-1] * told[1:]) > FAR**2)
    # Products of independent samples are uncorrelated: of any law, their mean varies by this much.
    chance = 1 / math.sqrt(products.size)
    quiet, out = 0.0, (0, 1.0)
    if under is not None:
        apart = -row[:-2] * row[2:]
        swings = _signed(apart, TOLERATED_SWING)[0] if apart.size else 1.0
        evidence = (2 * evidence + _followed(row, under.moves) + swings) / 4
        quiet = under.quiet / math.sqrt(noise)
        far = far or far_behind_steps(row, under.moves)
        out = outliers(told, under.resolved / math.sqrt(noise), under.moves)
    blows = in_blows(told, quiet, claimed, None if under is None else under.moves)
    # What comes in blows is no noise, rough as it is: the sensor's is.
    own = min(quiet or 1.0, 1.0) if blows > EXPLAINED else 1.0
    return Misfit(
        math.exp(MOST_LOG) if loud else min(evidence * blows, math.exp(MOST_LOG)),
        excess,
        math.sqrt(float(np.mean(square))) / own,
        math.sqrt(float(np.mean(relative))) / own,
        float(np.mean(products)),
        chance,
        far or loud or blows > EXPLAINED,
        math.sqrt(noise),
        *out,
    )


def _remembers(residual: Array) -> bool:
    """Whether samples up to `LAGS` apart agree in sign, or do not, beyond one chance in a million.

    Given the sizes, each product's sign is fair (Hoeffding, Journal of the American Statistical
    Association 58, 1963).
    """
    for lag in range(1, min(LAGS, residual.size - 1) + 1):
        products = residual[:-lag] * residual[lag:]
        if abs(products.sum()) > REMEMBERED * math.sqrt(float(np.sum(np.square(products)))):
            return True
    return False


def _signed(products: Array, tolerated: float) -> tuple[float, float]:
    """(e-value, sum in its deviations) of (N,) products of fair signs, beyond what is tolerated."""
    surplus, squares = products - tolerated, np.square(products)
    levels = []
    whole = 0.0
    count = 1
    while count == 1 or products.size // count >= STRETCH:
        edges = _edges(products.size, count)
        above = np.add.reduceat(surplus, edges)
        spread = np.sqrt(np.add.reduceat(squares, edges))
        z = above / np.maximum(spread, 1e-150)
        if count == 1:
            whole = float(z[0])
        powers = _SIZES * z - _HALVES
        levels.append(float(np.mean(np.exp(np.minimum(powers, MOST_LOG)))))
        count *= 2
    return float(np.mean(levels)), whole


def _followed(row: Array, moves: Array) -> float:
    """e-value of bets on the signs of (L,) samples times each of the (L, m) movements."""
    size = np.abs(moves)
    largest = size.max(axis=0)
    moving = largest > 0
    if not moving.any():
        return 1.0
    parts = np.clip(moves[:, moving] / (LARGE_STEP * largest[moving]), -1.0, 1.0)
    # Not in deviations of the noise, which the signs have a part in.
    most = FAR * max(float(np.median(np.abs(row))) / NORMAL_MEDIAN, math.sqrt(LEAST_SQUARE))
    signs = np.clip(row / most, -1.0, 1.0)[:, np.newaxis] * parts
    usual = np.sqrt(np.mean(np.square(parts), axis=0))
    tolerated = math.sqrt(TOLERATED) * min(1.0 / most, 1.0 / FAR) * row.size * usual
    won = np.stack([np.sum(np.log1p(b * signs), axis=0) - abs(b) * tolerated for b in BETS])
    return float(np.mean(np.exp(np.minimum(won, MOST_LOG))))
