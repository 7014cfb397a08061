"""`identify`: a machine file for a machine of which no physics is known.

Voltage in and speed out of a DC motor with a rigid load have three numbers: steady gain G, and two
time constants tau_m and tau_e of

    tau_m tau_e speed'' + tau_m speed' + speed = G voltage

Any motor with the same three behaves the same, whatever its resistance. The EQUIVALENT motor is the
one with R = 1 Ohm and b = 0:

    K_t = 1 / G,    J = tau_m K_t^2 / R,    L = R tau_e

Its torques and currents are equivalents too: ratios of them mean something, single values do not.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ldt_core.base.errors import LdtError, OptionError
from ldt_core.base.experiment import Experiment
from ldt_core.base.metrics import FreeRunError
from ldt_core.base.printable import printable
from ldt_core.base.threads import one_thread
from ldt_core.calibration.calibration import (
    MOST_NOISE_RATIO,
    Posterior,
    free_run_error,
    limits_note,
    padded_range,
    rounded,
)
from ldt_core.calibration.equivalent_motor import MotorResponse, fit_response
from ldt_core.calibration.equivalent_posterior import equivalent_posterior
from ldt_core.calibration.held_out import split_evenly
from ldt_core.calibration.torque_balance import CONVENTION, RESISTANCE, guidance
from ldt_core.estimation.linear import Identified, identify
from ldt_core.estimation.noise import white_noise
from ldt_core.machine.direction_check import swapped
from ldt_core.machine.machine_file import Machine, machine_from_dict

PHYSICS = "dc_motor"
FRICTION = 0.0  # N m s, by convention, likewise
SLOWEST_MOTION = 3.0  # longest experiments: of a slower one any gain fits the beginning
LEAST_FIT_PERCENT = 90.0  # of the speed: a motor that explains less may be refused
REFUSAL_RATIO = 2.0  # of what a motor leaves to what the best linear model of any order leaves
DIFFERENT = 0.5  # of what is left: a half that leaves less by a motor of its own is another machine
FEWEST_OF_A_HALF = 4  # experiments, to say that the two halves differ
NOTE_RATIO = 1.2  # of the same: beyond, the motor lacks something, which is worth a note


@dataclass(frozen=True)
class EquivalentMotor:
    """The equivalent motor and how far it explains the recording.

    Attributes:
        machine: with the equivalent parameters; its `calibration` is `as_dict()`.
        form: gain, time constants and offset.
        linear: the linear model of free form that the recording shows.
        errors: "fit" and, when experiments were held out, "held_out" → free runs of the machine
            from the first measured sample, as `ldt predict` makes them [rad/s].
        linear_errors: the same for the linear model of free form, offset included.
        experiments: numbers of the experiments by the same keys.
        notes: sentences for a person.
        recordings: the files.
        changed: whether the machine seems to have changed while it was recorded.
        posterior: what is known of J, K_t and L; None where the motor lacks something.
    """

    machine: Machine
    form: MotorResponse
    linear: Identified
    errors: dict[str, FreeRunError]
    linear_errors: dict[str, FreeRunError]
    experiments: dict[str, list[int]]
    notes: tuple[str, ...]
    recordings: tuple[str, ...] = ()
    changed: bool = False
    posterior: Posterior | None = None

    def with_recordings(self, recordings: Sequence[str]) -> EquivalentMotor:
        """The same, with the names of the files it was made from."""
        named = replace(self, recordings=tuple(recordings))
        return replace(named, machine=replace(self.machine, calibration=named.as_dict()))

    def as_dict(self) -> dict[str, Any]:
        """The machine file's key `calibration`, in JSON types."""
        form = self.form
        record: dict[str, Any] = {
            "recordings": [printable(name) for name in self.recordings],
            "equivalent": True,
            "gain": rounded(form.gain),
            "time_constants": [rounded(t) for t in form.time_constants],
            "oscillates": form.oscillates,
            "offset": rounded(form.offset),
            "noise": {"speed": self.machine.simulation["noise"]},
            "fit_percent": rounded(form.fit_percent),
            "linear_order": self.linear.order,
            "linear_poles": [[rounded(p.real), rounded(p.imag)] for p in self.linear.poles],
            "experiments": self.experiments["fit"],
            "rmse": rounded(self.errors["fit"].rmse),
            "linear_rmse": rounded(self.linear_errors["fit"].rmse),
        }
        if "held_out" in self.errors:
            record["held_out"] = {
                "experiments": self.experiments["held_out"],
                "rmse": rounded(self.errors["held_out"].rmse),
                "mean_max_error": rounded(self.errors["held_out"].mean_max_error),
                "linear_rmse": rounded(self.linear_errors["held_out"].rmse),
            }
        if self.posterior is not None:
            values = self.machine.parameters
            record["free"] = {
                name: {"value": values[name], "std": rounded(relative * values[name])}
                for name, relative in self.posterior.deviations.items()
            }
            record["posterior"] = self.posterior.as_dict()
        record["notes"] = list(self.notes)
        return record


def identify_machine(
    experiments: Sequence[Experiment],
    name: str,
    *,
    order: int = 0,
    offset: bool = True,
    limits: tuple[float, float] | None = None,
    holdout: float | None = None,
    tick: Callable[[str], None] = lambda doing: None,
) -> EquivalentMotor:
    """The motor that is equivalent to an unknown machine, from voltage and speed.

    Args:
        experiments: measured, of one sample period; each a free run of its own.
        name: of the machine.
        order: number of time constants, 1 or 2; 0 for as many as the recording shows.
        offset: fit an offset of the steady speed where the recording shows one, so that it does not
            distort the gain; the machine file has no place for it.
        limits: lowest and highest voltage that the machine may get [V]; None takes the recorded
            range with 0 V, widened a little.
        holdout: share of the experiments to judge by, None for a quarter when there are at least 4.
        tick: called with what is being done, for a progress display.

    Raises:
        OptionError: a name, order, range or share that is none.
        ExperimentError: experiments of different sample periods, or outside the limits.
        LdtError: the experiments determine no linear model, or one that is no motor's.
    """
    if not name:
        raise OptionError("--name", "a name", repr(name))
    if order not in (0, 1, 2):
        raise OptionError("--order", "1 or 2, or 0 to choose", repr(order))
    if limits is not None and not (-math.inf < limits[0] < limits[1] < math.inf):
        raise OptionError("--limits", "LOWEST,HIGHEST in V", f"{limits[0]:g},{limits[1]:g}")
    kept, held_out, beside = split_evenly(experiments, holdout)
    tick("identifying a linear model")
    try:
        linear = identify(kept)
    except LdtError as error:
        if error.exit_code == LdtError.exit_code and (words := guidance(kept)):
            raise LdtError(f"{error}{words}") from error
        raise
    tick("fitting the equivalent motor")
    with one_thread():
        form = fit_response(kept, linear, order, offset)
    _refuse(form, linear, kept)
    errors, linear_errors, numbers = {}, {}, {}
    machine = _machine(form, name, experiments, limits)
    for e in experiments:
        machine.check(e)
    for part, some in (("fit", kept), ("held_out", held_out)):
        if some:
            errors[part] = free_run_error(machine, some)
            linear_errors[part] = _linear_error(linear, some)
            numbers[part] = [e.number for e in some]
    notes = beside + _notes(form, linear, kept) + [*filter(None, [swapped(kept)])]
    notes += [limits_note(machine)] if limits is None else []
    changed = ""
    if sensor_noise(form, kept) < form.noise_std:
        changed = _differing(form, linear, kept)
        notes += filter(None, [changed])
    tick("estimating how well the motor is known")
    found = EquivalentMotor(
        machine,
        form,
        linear,
        errors,
        linear_errors,
        numbers,
        tuple(notes),
        changed=bool(changed),
        posterior=None if changed else equivalent_posterior(machine, kept, form.order),
    )
    return found.with_recordings(())


def _refuse(form: MotorResponse, linear: Identified, experiments: list[Experiment]) -> None:
    """Refuse what is no motor, with an LdtError that says what was found."""
    shown = _described(linear)
    longest = max(e.duration for e in experiments)
    if form.gain <= 0:
        raise LdtError(
            f"the recording shows no motor but {shown}: {_backwards(linear, experiments)}"
            f"{guidance(experiments)}"
        )
    if form.slowest > SLOWEST_MOTION * longest:
        raise LdtError(
            f"the recording shows no motor but {shown}: a time constant of {form.slowest:.3g} s, "
            f"of which experiments of {longest:.3g} s show the beginning only (longer ones would "
            f"settle it, unless the speed is unstable){guidance(experiments)}"
        )
    if form.fit_percent < LEAST_FIT_PERCENT and form.noise_std > REFUSAL_RATIO * linear.noise_std:
        other = ""
        if _differing(form, linear, experiments):
            other = "; or it changed meanwhile, and the experiments before and after go apart"
        raise LdtError(
            f"the recording shows no motor but {shown}, which leaves {linear.noise_std:.3g} rad/s "
            f"where a motor leaves {form.noise_std:.3g} rad/s: a machine with more than two time "
            f"constants needs a physics of its own (ldt docs physics){guidance(experiments)}"
            f"{other}"
        )


def _backwards(linear: Identified, experiments: Sequence[Experiment]) -> str:
    """Why the gain of a motor would not be positive, in words."""
    if any(e.voltage.min() < 0 for e in experiments) and all(
        e.speed.min() >= 0 for e in experiments
    ):
        return (
            "the voltage turns its sign and the speed never does, as of a sensor without direction"
        )
    if linear.dc_gain > 0:
        return "no motor's speed follows a voltage so, as of a sensor that stands still for a while"
    return (
        "the speed falls as the voltage rises, so that one of the two has the wrong sign (turn it "
        "and import again) or the speed hardly depends on the voltage"
    )


def _described(linear: Identified) -> str:
    poles = []
    for pole in linear.poles:
        if pole.imag > 0:
            poles.append(f"{pole.real:.3g} ± {pole.imag:.3g} i")
        elif pole.imag == 0:
            poles.append(f"{pole.real:.3g}")
    return (
        f"a linear model of order {linear.order} with gain {linear.dc_gain:.3g} rad/s per V and "
        f"pole{'s' if linear.order > 1 else ''} {', '.join(poles)} 1/s"
    )


def _machine(
    form: MotorResponse,
    name: str,
    experiments: Sequence[Experiment],
    limits: tuple[float, float] | None,
) -> Machine:
    constant = 1.0 / form.gain
    parameters = {
        "J": form.tau_m * constant**2 / RESISTANCE,
        "K_t": constant,
        "R": RESISTANCE,
        "L": RESISTANCE * form.tau_e,
        "b": FRICTION,
    }
    low = min(float(e.voltage.min()) for e in experiments)
    high = max(float(e.voltage.max()) for e in experiments)
    lengths = [len(e) for e in experiments]
    samples = max(set(lengths), key=lambda n: (lengths.count(n), n))
    period = experiments[0].period
    machine = Machine(
        name=name,
        physics=PHYSICS,
        parameters={n: rounded(v) for n, v in parameters.items()},
        voltage_limits=limits or padded_range(low, high),
        duration=rounded(samples * rounded(period)),
        sample_period=rounded(period),
        simulation={
            "voltage": {"kind": "steps", "low": rounded(low), "high": rounded(high)},
            "noise": rounded(sensor_noise(form, experiments)),
        },
    )
    return machine_from_dict(machine.as_dict(), "the motor found")  # as whoever reads it would


def sensor_noise(form: MotorResponse, experiments: Sequence[Experiment]) -> float:
    """Deviation of the sensor's noise [rad/s].

    It is what the motor leaves, unless that is smooth: then the motor lacks something.
    """
    white = white_noise(e.speed for e in experiments)
    return white if 0 < white < form.noise_std / MOST_NOISE_RATIO else form.noise_std


def _differing(form: MotorResponse, linear: Identified, experiments: list[Experiment]) -> str:
    """A note where a motor of its own explains one half of the experiments far better; else ""."""
    middle = len(experiments) // 2
    if middle < FEWEST_OF_A_HALF:
        return ""
    halves = [
        fit_response(h, linear, form.order) for h in (experiments[:middle], experiments[middle:])
    ]
    first, last = halves
    if min(h.noise_std for h in halves) > DIFFERENT * form.noise_std:
        return ""
    return (
        f"The machine may have changed: a motor of the first half alone leaves "
        f"{first.noise_std:.3g} rad/s there, with gain {first.gain:.4g}; one of the last half "
        f"{last.noise_std:.3g}, with gain {last.gain:.4g}."
    )


def _linear_error(linear: Identified, experiments: Sequence[Experiment]) -> FreeRunError:
    """Free runs of the linear model, begun as `ldt run --model linear` begins them."""
    error = FreeRunError()
    assert linear.start is not None
    for e in experiments:
        start = linear.start.at(float(e.speed[0]))
        error.add(e.speed - linear.simulate(e.voltage, e.period, start))
    return error


def _notes(form: MotorResponse, linear: Identified, experiments: list[Experiment]) -> list[str]:
    notes = [CONVENTION]
    if form.order == 1:
        notes.append(
            "The recording shows one time constant; L is "
            f"{form.tau_e / experiments[0].period:g} of a sample period, too small to matter."
        )
    if form.oscillates:
        notes.append(
            "The time constants are complex, as of a motor whose inductance is large (4 L / R > "
            "tau_m): an elastic shaft or a slow sensor may look like it."
        )
    if form.offset:
        notes.append(
            f"The steady speed is {form.offset:+.3g} rad/s off gain times voltage, as by a load, "
            "dry friction or a sensor's bias: no dc_motor has that, and the file leaves it out."
        )
    if form.fit_percent < LEAST_FIT_PERCENT:
        noise = sensor_noise(form, experiments)
        missing = "the recording may be mostly noise"
        if noise < form.noise_std:
            missing = f"{form.noise_std:.3g} rad/s are left, and the noise is {noise:.2g}"
        notes.append(
            f"This motor explains {form.fit_percent:.0f} % of the speed, and no linear model does "
            f"much better: {missing}."
        )
    words = guidance(experiments)
    if not words and form.noise_std > NOTE_RATIO * linear.noise_std:
        notes.append(
            f"The motor leaves {form.noise_std:.3g} rad/s, {_described(linear)} leaves "
            f"{linear.noise_std:.3g}: this machine has something that a motor lacks."
        )
    if words:
        notes.append(
            f"This is more than a motor{words}. Or keep this file, and let `ldt diagnose` say what "
            "it lacks."
        )
    if any(e.current is not None for e in experiments):
        notes.append(
            "The recording has the current, which was not used: `ldt calibrate` with this file "
            "turns equivalents into the motor's own values."
        )
    return notes
