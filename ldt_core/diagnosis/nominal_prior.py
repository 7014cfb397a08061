"""What a machine file knows of its own numbers, as a prior of every fit of a diagnosis.

The numbers take part in each fit as one candidate that is never named. Its coordinates are those in
which the file's knowledge is round: independent, with deviation 1. A Gaussian prior alone restrains
nothing where a gap is a thousand times the noise, so none of them leaves the range that the file
allows. What is further off is a change of the machine, which an effect of the library names.
"""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import OptionError, did_you_mean
from ldt_core.diagnosis.candidate import Candidate
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.machine.machine_file import Machine
from ldt_core.machine.stated_posterior import fitted_to, stated_posterior
from ldt_core.physics.effect import Effect
from ldt_core.physics.parameter import Parameter

#: Parameter to the effect that changes it.
CHANGED_BY = {
    "J": "inertia",
    "K_t": "motor_constant",
    "R": "armature_resistance",
    "L": "armature_inductance",
    "b": "viscous_friction",
    "K_x": "foundation_stiffness",
    "K_y": "foundation_stiffness",
    "R_x": "foundation_damping",
    "R_y": "foundation_damping",
    "e": "unbalance",
}
MOTOR = ("J", "K_t", "L", "R", "b")  # the numbers of a motor, which shake no foundation
RIDGE_STEP = 1e-4  # of a move, for the slope at its start
EQUIVALENT = ("J", "K_t", "L")  # of an identified motor; its R and b are convention
NONE = "none"
NOMINAL = "nominal_parameters"  # name of the candidate
#: Deviation of a logarithm that stands for no knowledge: a file fitted to the very recording that
#: is diagnosed knows nothing beside it, and its values have made up for what the file lacks.
UNKNOWN = 1.0
WELL_KNOWN = 0.3  # deviation of a logarithm, up to which what it moves hardly changes its shape
DIFFERENCE = 1e-3  # of a parameter, for difference quotients
LONGEST_DIFFERENCE = 0.1  # deviations, for those known very well
REMEMBERED = 64  # coordinates whose factors are: those of one set's differences


@dataclass(frozen=True, eq=False)
class NominalCandidate(Candidate):
    """The numbers of a machine file that are not known for certain, as a candidate.

    Attributes:
        columns: coordinates of the prior that it consists of.
    """

    columns: tuple[int, ...] = ()

    @property
    def steady(self) -> bool:  # type: ignore[override]
        """Whether the numbers are known well enough for that."""
        return max(p.scale or 0.0 for p in self.parameters) < WELL_KNOWN

    def scaled(self, z: Array, scale: float) -> Array:
        """The same: the machine's numbers are no effect that may be weaker."""
        return z

    def at_limit(self, z: Array) -> list[str]:
        """None: how far the machine's own parameters may go is their prior's to say."""
        return []

    @property
    def differences(self) -> Array:
        """(k,) steps that move a parameter by about `DIFFERENCE`."""
        root = np.array([p.scale or 0.0 for p in self.parameters])
        return np.minimum(DIFFERENCE / np.maximum(root, 1e-12), LONGEST_DIFFERENCE)

    def scale(self, j: int) -> float:
        """1: coordinates are deviations."""
        return 1.0


@dataclass(frozen=True, eq=False)
class NominalPrior:
    """A normal law of the logarithms of a machine's numbers over the file's.

    Attributes:
        names: parameters that are uncertain.
        root: (k, r) square root of the covariance: logarithms per coordinate.
        known: False where the file was fitted to this recording, and so knows nothing of its own.
        columns: which coordinates of the whole prior these are; () for all.
        curved: whether what the file knows best is the motor's transfer function, which keeps its
            own law while the others move; see `_motor_along`.
    """

    machine: Machine
    names: tuple[str, ...]
    root: Array
    known: bool = True
    columns: tuple[int, ...] = ()
    curved: bool = False

    @property
    def deviations(self) -> dict[str, float]:
        """Relative standard deviation of each parameter."""
        sizes = np.sqrt(np.sum(self.root**2, axis=1)) if self.names else np.zeros(0)
        return dict(zip(self.names, sizes.tolist(), strict=True))

    @property
    def swallowed(self) -> set[str]:
        """Effects that no data tell from these numbers, as nothing is known of them."""
        return set() if self.known else {CHANGED_BY[n] for n in self.names}

    def factors(self, coordinates: Array) -> dict[str, float]:
        """What the parameters are multiplied by at (r,) coordinates."""
        moved = dict(zip(self.names, (self.root @ coordinates).tolist(), strict=True))
        with np.errstate(over="ignore", invalid="ignore"):  # a machine that is then not simulated
            if self.curved:
                moved.update(_motor_along(self.machine.parameters, moved))
            return {n: float(np.exp(by)) for n, by in moved.items()}

    def among(self, columns: Sequence[int]) -> NominalPrior:
        """With some of the coordinates only: the others stay at the file's values."""
        return replace(self, root=self.root[:, list(columns)], columns=tuple(columns))

    def candidate(self) -> NominalCandidate:
        """It, as a member of every set."""
        far = THRESHOLDS.prior_deviations
        sizes = np.abs(self.root).max(axis=0)

        # A set's differences move the effects' parameters, and these numbers seldom.
        factors = functools.lru_cache(REMEMBERED)(lambda given: self.factors(np.array(given)))

        def changed(values: Mapping[str, float], **given: float) -> dict[str, float]:
            found = factors(tuple(given.values()))
            return {**values, **{n: values[n] * f for n, f in found.items()}}

        effect = Effect(
            name=NOMINAL,
            description="the machine file's own numbers, as far as they are uncertain",
            equation="parameter := parameter exp(root u)",
            parameters=tuple(
                Parameter(f"u_{j}", "", -far, far, 0.0, "coordinate", scale=float(size))
                for j, size in enumerate(sizes)
            ),
            on_parameters=changed,
        )
        return NominalCandidate(effect, {}, columns=self.columns or tuple(range(len(sizes))))


def nominal_prior(
    machine: Machine, refit: Sequence[str] | None = None, recordings: Sequence[str] = ()
) -> NominalPrior | None:
    """What is known of the numbers of a machine file; None where all of them are exact.

    Those are uncertain of which the file states a deviation or says that they were fitted. A number
    without either is exact.

    Args:
        refit: names instead, within their tolerances; ["none"] for no parameter.
        recordings: that are diagnosed. A file that was fitted to one of them knows nothing else.

    Raises:
        OptionError: a name in `refit` that is no parameter of this machine.
    """
    known = [n for n in CHANGED_BY if n in machine.parameters]
    if refit is not None:
        names = [n for n in refit if n != NONE]
        for name in names:
            if name not in known:
                raise OptionError("--refit", did_you_mean(name, [*known, NONE]), repr(name))
    else:
        names = _uncertain(machine)
    names = [n for n in known if n in names and machine.parameters[n] != 0]
    if refit is None and fitted_to(machine, recordings):
        return NominalPrior(machine, tuple(names), UNKNOWN * np.eye(len(names)), known=False)
    if refit is None and (together := _posterior(machine)) is not None:
        return _with_masses(together)
    tolerances = machine.tolerances
    names = [n for n in names if tolerances.get(n, 0.0) > 0]
    found = NominalPrior(machine, tuple(names), np.diag([tolerances[n] for n in names]))
    found = found if refit is not None else _with_masses(found)
    return found if found.names else None


def _with_masses(prior: NominalPrior) -> NominalPrior:
    """The same, with what the tolerances of a foundation's and a rotor's mass leave open.

    A speed shows only K / (M + m), R / (M + m) and (m e)^2 / (M + m), as the equations of the
    foundation say once they are divided by its whole mass and their two forces are multiplied. So a
    mass that is off is a stiffness, a damping and an e that are off together.
    """
    open_by = masses_leave_open(prior.machine)
    moved = [n for n in open_by if prior.machine.parameters.get(n)]
    if not moved:
        return prior
    names = [*prior.names, *(n for n in moved if n not in prior.names)]
    columns = np.zeros((len(names), len(open_by[moved[0]])))
    for name in moved:
        columns[names.index(name)] = open_by[name]
    root = np.zeros((len(names), prior.root.shape[1]))
    root[: len(prior.names)] = prior.root
    return replace(prior, names=tuple(names), root=np.hstack([root, columns]))


def masses_leave_open(machine: Machine) -> dict[str, Array]:
    """(2,) by how much one deviation of m, and of M, moves the logarithm of what stands for them.

    See `_with_masses`. Empty where the file states no deviation of either mass: they are exact.
    """
    masses, values = ("m", "M"), machine.parameters
    if not any(n in machine.deviations for n in masses) or "e" not in values:
        return {}
    sizes = np.array([values[n] for n in masses])
    spread = np.array([machine.deviations.get(n, 0.0) for n in masses]) / sizes
    part = sizes / sizes.sum()
    moved = {n: -part * spread for n in ("K_x", "K_y", "R_x", "R_y")}
    return {**moved, "e": (np.array([1.0, 0.0]) - part / 2) * spread}


def _uncertain(machine: Machine) -> list[str]:
    if machine.calibration.get("equivalent"):
        return list(EQUIVALENT)
    free = machine.calibration.get("free", {})
    return [*machine.deviations, *(free if isinstance(free, dict) else ())]


def _posterior(machine: Machine) -> NominalPrior | None:
    """What the file's calibration says of its numbers together; None where it says nothing."""
    told = stated_posterior(machine)
    if told is None or not set(told[0]) <= {n for n in CHANGED_BY if machine.parameters.get(n)}:
        return None
    return NominalPrior(machine, *told, curved=set(MOTOR) <= set(told[0]))


def _motor_along(values: Mapping[str, float], moved: Mapping[str, float]) -> dict[str, float]:
    """Logarithms of what J, K_t and L are multiplied by, where the motor's numbers move far.

    A recording of voltage and speed determines the coefficients of

        speed / voltage = K_t / (L J s^2 + (L b + R J) s + K_t^2 + R b)

    far better than the numbers in them. A move that is straight in the numbers' logarithms leaves
    that valley, since it is curved. So the coefficients move straight, by their slopes along
    `moved`; R and b move as they are told to, and the other three follow from all of these.

    Args:
        values: of the file.
        moved: name to the change of its logarithm.
    """
    logs = np.log([values[n] for n in MOTOR])
    by = np.array([moved[n] for n in MOTOR])
    slope = (_coefficients(logs + RIDGE_STEP * by) - _coefficients(logs - RIDGE_STEP * by)) / 2
    gain, first, second = np.exp(_coefficients(logs) + slope / RIDGE_STEP)
    r, b = np.exp((logs + by)[3:])
    j, k, inductance = np.exp(logs[:3])
    # Two motors have such a gain, and two such a lag: the one that is like the file's is meant.
    root = np.sqrt(max(1 - 4 * gain**2 * r * b, 0.0))
    k = (1 + math.copysign(root, k * k - values["R"] * values["b"])) / (2 * gain)
    whole = k * k + r * b
    root = np.sqrt(max((first * whole) ** 2 - 4 * r * b * second * whole, 0.0))
    slow = values["R"] * j - inductance * values["b"]
    j = (first * whole + math.copysign(root, slow)) / (2 * r)
    found = np.log([j, k, second * whole / j]) - logs[:3]
    return dict(zip(MOTOR[:3], found.tolist(), strict=True))


def _coefficients(logs: Array) -> Array:
    """(3,) logarithms of a motor's gain, and of what its speed's slopes are multiplied by."""
    j, k, inductance, r, b = np.exp(logs)
    whole = k * k + r * b
    return np.log([k / whole, (inductance * b + r * j) / whole, inductance * j / whole])


def known_colour(machine: Machine, recordings: Sequence[str] = ()) -> dict[str, tuple[float, ...]]:
    """By channel whose noise is not white, what the file's calibration saw of it.

    The limits come from the healthy machine's records: where its physics lacked nothing, none of
    them is diagnosed, and the file has not been edited since.

    Returns:
        Deviations of white noise that is as rough, of what was left, and of white noise that is as
        strong at low frequencies.
    """
    told = machine.calibration
    if told.get("lacking") != [] or fitted_to(machine, recordings) or _posterior(machine) is None:
        return {}
    noise, coloured = told.get("noise"), told.get("coloured_noise")
    if not isinstance(noise, dict) or not isinstance(coloured, dict):
        return {}
    found = {}
    for channel, parts in coloured.items():
        with contextlib.suppress(KeyError, TypeError, ValueError):
            sizes = tuple(float(v) for v in (parts["white"], noise[channel], parts["slow"]))
            if 0 < sizes[0] < sizes[2] < math.inf and 0 < sizes[1] < math.inf:
                found[str(channel)] = sizes
    return found


def merged(
    machine: Machine, use: Sequence[tuple[Effect, Mapping[str, float]]]
) -> list[tuple[Effect, Mapping[str, float]]]:
    """The same with the nominal parameters as effects of the library, none of them twice."""
    found: dict[str, tuple[Effect, dict[str, float]]] = {}
    values: Mapping[str, float] = machine.parameters
    for effect, given in use:
        if effect.name != NOMINAL:
            found[effect.name] = effect, dict(given)
            values = effect.change_parameters(machine.model, values, given)
            continue
        after = effect.change_parameters(machine.model, values, given)
        for name, change in CHANGED_BY.items():
            if name not in after or after[name] == values.get(name):
                continue
            own = machine.effect(change)
            _, now = found.setdefault(change, (own, dict(own.neutral)))
            if "factor" in now:
                now["factor"] *= after[name] / values[name]
            elif name in now:
                now[name] += after[name] - values[name]
            else:  # stiffness and damping of a foundation, by their direction
                now[name[-1]] *= after[name] / values[name]
        values = after
    # An e below the file's has no effect that lowers it; none is what comes nearest.
    return [
        (effect, {p.name: min(max(given[p.name], p.low), p.high) for p in effect.parameters})
        for effect, given in found.values()
    ]
