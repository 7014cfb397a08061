"""Whether what was named stands by itself on experiments that it was not fitted to.

A share of a huge gap proves nothing: a shaft that stands still closes most of it, too. So the error
that a named set leaves is compared with what needs no machine at all, with a linear model, and with
the machine file and one free curve.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment, rms
from ldt_core.diagnosis.diagnosis import HeldOutErrors
from ldt_core.diagnosis.effect_fit import EffectFit
from ldt_core.diagnosis.effect_set_search import EffectSetSearch
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.holdout import beyond_noise, errors, errors_of, free_run, noise_there
from ldt_core.diagnosis.model_selection import FittedSets
from ldt_core.diagnosis.sentence import not_all_alike
from ldt_core.diagnosis.simulated_experiments import StartStates, Used
from ldt_core.diagnosis.start_angles import ANGLE_TOLERANCE
from ldt_core.diagnosis.static_curve import FreeCurves
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.diagnosis.verdict import Decision, choose
from ldt_core.machine.machine_file import Machine
from ldt_core.models.linear import LinearModel

LINEAR_ORDER = 2  # of the linear model: a motor's, speed and current
LEFT = 1 - THRESHOLDS.further_effect_of_remainder  # of a gap elsewhere, by what is no cause
#: Errors without a set and with it; see `begun_errors`.
Begun = tuple[HeldOutErrors, HeldOutErrors] | None


class Standing(NamedTuple):
    """What was decided once held-out experiments had been asked.

    Attributes:
        decision: the first, or the one in its place.
        objection: why its set is not the answer, as the end of a sentence; "" if it is.
        before, after: (L,) free runs of the held-out experiments without it and with it [rad/s].
        begun: as `begun_errors` has them.
        beaten: error that its set leaves where a curve leaves far less [rad/s]; else infinite.
    """

    decision: Decision
    objection: str
    before: list[Array]
    after: list[Array]
    begun: Begun
    beaten: float = math.inf


def standing(
    machine: Machine,
    search: EffectSetSearch,
    decision: Decision,
    fitted: Sequence[Experiment],
    held: Sequence[Experiment],
    seed: int,
) -> Standing:
    """What was decided, or in place of a set that does not stand one that does.

    A set that was refuted is no rival of a larger one, however far its laws might depart. What
    leaves more than a set that a curve has beaten is no answer either.
    """
    before = [free_run(machine, e) for e in held]
    curves = FreeCurves(machine, fitted, held, before)
    first: Standing | None = None
    beaten = math.inf
    refuted = search.found.refuted
    while decision.best and decision.kind != "unknown":
        now = _asked(machine, decision, decision.best, search, fitted, held, curves)
        if not now.objection and errors(held, now.after).rmse < beaten:
            return now
        beaten = min(beaten, now.beaten)
        first, names = first or now, frozenset(decision.best.names)
        if names in refuted:  # nothing else is left
            break
        refuted.add(names)
        decision = choose(search, seed)
    if first is None and decision.best:  # it leaves too much: a curve may say of what kind
        now = _asked(machine, decision, decision.best, search, fitted, held, curves)
        first = now if now.beaten < math.inf else None
    return first or Standing(decision, "", before, before, None)


def _asked(
    machine: Machine,
    decision: Decision,
    best: EffectFit,
    search: EffectSetSearch,
    fitted: Sequence[Experiment],
    held: Sequence[Experiment],
    curves: FreeCurves,
) -> Standing:
    before = curves.before
    after = [free_run(machine, e, best.use) for e in held]
    noise = noise_there(held, after, decision.residuals.noise[0], search.found.band.limit)
    begun = begun_errors(machine, best, held)
    pair = begun or (errors(held, before), errors(held, after))
    why = (
        objection(machine, best, fitted, held, *pair, noise)
        or unlike_current(search.found, best)
        or (begun and astray(held, before, after))
        or ""
    )
    if not why and begun is None and _apart(fitted, held):
        instead = curves.instead(best, after, noise)
        if instead:
            why, error = f"it leaves {pair[1].rmse:.3g} rad/s, where {instead}", pair[1].rmse
            return Standing(decision, why, before, after, begun, error)
    return Standing(decision, why, before, after, begun)


def objection(
    machine: Machine,
    best: EffectFit,
    fitted: Sequence[Experiment],
    held: Sequence[Experiment],
    before: HeldOutErrors,
    after: HeldOutErrors,
    noise: float,
) -> str:
    """Why a set of effects is not the answer, as the end of a sentence; "" if it stands.

    Args:
        fitted, held: experiments that it was fitted to, and those held out.
        before, after: errors on the latter without it and with it.
        noise: deviation of the sensor's there [rad/s].
    """
    if not np.isfinite(after.rmse):
        return "with it held-out experiments cannot be simulated"
    # An error without it that is no number is one without bound, which anything finite improves.
    # Part of the one experiment that it was fitted to begins in a state that nobody has measured.
    apart = _apart(fitted, held)
    worse = np.isfinite(before.rmse) and after.rmse >= before.rmse
    if apart and worse and _fails(machine, best, fitted, held, noise):
        return (
            f"it leaves {after.rmse:.3g} rad/s on held-out experiments, where {before.rmse:.3g} "
            "were without it"
        )
    if best.ended:
        return f"its fit ended at the limit of the search ({', '.join(best.ended)})"
    if not apart:
        return ""
    left = max(after.rmse**2 - noise**2, 0.0)
    speed = np.concatenate([e.speed for e in held])
    mean = float(np.mean(np.concatenate([e.speed for e in fitted])))
    for name, level in (("a shaft that stands still", 0.0), ("a constant speed", mean)):
        power = float(np.mean((speed - level) ** 2))
        moved = beyond_noise(math.sqrt(power), noise, speed.size)
        # Where nothing moves beyond noise, nothing could fail: no cause has been put to the test.
        if moved <= 0 or left > THRESHOLDS.unexplained_of_signal * moved:
            return f"it leaves {after.rmse:.3g} rad/s, where {name} leaves {power**0.5:.3g}"
    # A gap may be larger than all that moves: that of a file of another machine, for one.
    gap = min(max(before.rmse**2 - noise**2, 0.0), moved)
    linear = _linear(machine, fitted, held)
    if linear is not None and not left < THRESHOLDS.trifle_of_gap * gap:
        power = errors(held, linear).rmse ** 2
        if left > THRESHOLDS.behind_reference * max(power - noise**2, noise**2):
            return (
                f"it leaves {after.rmse:.3g} rad/s, where a linear model without physics leaves "
                f"{power**0.5:.3g}"
            )
    # What closes less than half of the gap elsewhere follows what the fitted experiments show; of
    # what is worse there that was asked above.
    sure, whole = beyond_noise(after.rmse, noise, speed.size), before.rmse**2 - noise**2
    if sure > LEFT * whole and not worse and _fails(machine, best, fitted, held, noise):
        return f"it leaves {after.rmse:.3g} of {before.rmse:.3g} rad/s on held-out experiments"
    return ""


def astray(held: Sequence[Experiment], before: Sequence[Array], after: Sequence[Array]) -> str:
    """The objection that a set predicts the usual start worse than no machine would; "" if not.

    An angle of its own moves a run from one motion to another of the machine's. What drives the
    runs further away than a shaft at standstill is its start state, fitted to follow anything.

    Args:
        held: experiments held out.
        before, after: (L,) free runs of each without the set and with it [rad/s].
    """
    was, now = errors(held, before).rmse, errors(held, after).rmse
    still = rms(np.concatenate([e.speed for e in held]))
    if now <= max(was, still):
        return ""
    return (
        f"from the usual start it leaves {now:.3g} rad/s, where a shaft that stands still leaves "
        f"{still:.3g}"
    )


def unlike_current(found: FittedSets, best: EffectFit) -> str:
    """The objection that a set leaves most of what the current plainly shows; "" for none.

    What acts on the machine moves both, and of the current it leaves what its law is off by, at
    most. Where the speed shows no gap, the current is all that speaks for a set.
    """
    band, residuals = found.band, found.residuals
    currents = [e.current for e in residuals.experiments if e.current is not None]
    if not currents:
        return ""
    left, gap = (band.current_excess(r) for r in (best.residual, found.base))
    signal = sum(float(c @ c) for c in currents) / residuals.noise[1] ** 2
    law = THRESHOLDS.law_error**2 * signal if found.speed_shows else 0.0
    plainly = max(band.current_limit(THRESHOLDS.remainder_false_alarm), law)
    if left > plainly and left > THRESHOLDS.further_effect_of_remainder * gap:
        return "it leaves most of what the current shows"
    return ""


def _apart(fitted: Sequence[Experiment], held: Sequence[Experiment]) -> bool:
    """Whether those held out are no parts of the fitted ones."""
    return {e.number for e in held}.isdisjoint(e.number for e in fitted)


def _fails(
    machine: Machine,
    best: EffectFit,
    fitted: Sequence[Experiment],
    held: Sequence[Experiment],
    noise: float,
) -> bool:
    """Whether a set closes less than half of a gap that held-out experiments do show.

    First speeds and currents are fitted, which a free run takes with their noise. Noise is what the
    set leaves of the experiments that it was fitted to, where that is more. An effect that hardly
    acts in those held out is not refuted: there, a law may be off by as much as of any cause.
    """
    errors_in = [
        [
            errors_of(_speeds(residuals, use, residuals.start_states(use))).rmse
            for use in ((), best.use)
        ]
        for residuals in (FreeRunResiduals(machine, fitted), FreeRunResiduals(machine, held))
    ]
    if not np.isfinite(errors_in).all():
        return True
    (gap, usual), (was, now) = errors_in
    samples, least = sum(map(len, held)), max(noise, usual)
    left = beyond_noise(now, least, samples)
    if left <= THRESHOLDS.further_effect_of_gap * (gap**2 - least**2):
        return False
    return left > LEFT * beyond_noise(was, least, samples)


def unlike(
    machine: Machine,
    alone: EffectFit,
    fitted: Sequence[Experiment],
    held: Sequence[Experiment],
    noise: float,
) -> str:
    """The sentence where those held out show a gap that the others do not; "" if they do not.

    Parts of the one experiment begin in states that nobody has measured, and say nothing.

    Args:
        alone: the machine without any effect.
        fitted, held: experiments that show no gap, and those held out.
        noise: deviation of the sensor's there [rad/s].
    """
    if not _apart(fitted, held):
        return ""
    residuals = FreeRunResiduals(machine, held)
    # What no experiment shows beforehand, its first current and angle, is no gap either.
    begun = _speeds(residuals, alone.use, residuals.start_states(alone.use, free=True))
    single = [errors_of([speed]).rmse for speed in begun]
    left = errors_of(begun).rmse
    if left**2 <= THRESHOLDS.plainly_structured * noise**2:
        return ""
    return not_all_alike(left, held[int(np.argmax(single))].number, noise)


def begun_errors(machine: Machine, best: EffectFit, held: Sequence[Experiment]) -> Begun:
    """Errors on the held-out experiments without the set and with it, start states fitted.

    None where these are as the free runs have them. Where each experiment begins at an angle of its
    own, or in a warm winding, a free run from another start says nothing about the set.
    """
    if best.starts is None:
        return None
    own = len(machine.model.states)
    moved = any(np.any(offset[own:]) for offset in best.starts.offsets)
    if not moved and np.ptp(best.starts.angles) < ANGLE_TOLERANCE:
        return None
    residuals = FreeRunResiduals(machine, held)
    starts = residuals.start_states(best.use, free=True)
    return errors_of(_speeds(residuals, ())), errors_of(_speeds(residuals, best.use, starts))


def _speeds(
    residuals: FreeRunResiduals, use: Sequence[Used], starts: StartStates | None = None
) -> list[Array]:
    """(L,) errors of the speed in each experiment [rad/s]."""
    rows = residuals.of(use, starts=starts)
    return [rows[p.rows][: len(p.experiment)] * residuals.noise[0] for p in residuals.pieces]


def _linear(
    machine: Machine, fitted: Sequence[Experiment], held: Sequence[Experiment]
) -> list[Array] | None:
    """Its predictions; None where these experiments determine no linear model."""
    try:
        model = LinearModel(machine, order=LINEAR_ORDER).fit(fitted)
        return [model.predict(e).speed for e in held]
    except LdtError:
        return None
