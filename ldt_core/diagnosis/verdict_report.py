"""What was decided, told: amounts, places, candidates, sentence, and promises held out."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import repeat
from typing import Any

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.experiment import Experiment, rms
from ldt_core.base.sentences import spoken
from ldt_core.diagnosis.attribution import amounts, shapley_shares, share, with_masses
from ldt_core.diagnosis.confidence import all_grounds, confidence
from ldt_core.diagnosis.diagnosis import (
    Diagnosis,
    DrawnExperiment,
    Gap,
    GapLocation,
    NextExperiment,
    ParameterAmount,
    RankedCandidate,
    Refit,
    Remainder,
    Verdict,
)
from ldt_core.diagnosis.effect_fit import EffectFit
from ldt_core.diagnosis.effect_set_search import EffectSetSearch
from ldt_core.diagnosis.equally_good import as_fewer
from ldt_core.diagnosis.gap_location import places, steady_places
from ldt_core.diagnosis.holdout import (
    FEWEST_EXPERIMENTS,
    closed,
    errors,
    free_run,
    noise_there,
    regimes,
)
from ldt_core.diagnosis.next_experiment import next_experiment
from ldt_core.diagnosis.nominal import (
    STRAINED,
    as_calibrated,
    at_the_end,
    beside_effects,
    beyond,
    closing,
    enough,
    refits,
    said,
    with_all,
)
from ldt_core.diagnosis.nominal_prior import NOMINAL, NominalPrior, merged
from ldt_core.diagnosis.other_minima import as_well, undetermined
from ldt_core.diagnosis.promise import determined, further_interval
from ldt_core.diagnosis.recorded_times import counted_speed
from ldt_core.diagnosis.recorded_units import misread
from ldt_core.diagnosis.residual_torque import (
    TorqueEstimator,
    added_torque,
    depends_on,
    residual_torque,
)
from ldt_core.diagnosis.sentence import grown, not_measured, not_seen, not_standing, sentence
from ldt_core.diagnosis.simulated_experiments import Used
from ldt_core.diagnosis.standing import Standing, unlike
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.estimation.doubtful_speed import speed_doubt
from ldt_core.machine.machine_file import Machine

OWN_SCALE = (
    "the machine file is an equivalent motor (R = 1 Ohm by convention): torques, inertias and "
    "resistances are on its scale, not on the machine's"
)


def _told(machine: Machine, use: Sequence[Used]) -> list[dict[str, Any]]:
    """A set of effects with its values, the machine's own numbers among them as effects."""
    return [{"effect": e.name, "parameters": dict(given)} for e, given in merged(machine, use)]


def _seen(experiments: Sequence[Experiment]) -> dict[str, tuple[float, float]]:
    """Least and largest of what was recorded."""
    found = {}
    for name in ("voltage", "speed"):
        rows = [getattr(e, name) for e in experiments]
        found[name] = min(float(r.min()) for r in rows), max(float(r.max()) for r in rows)
    return found


def _unsimulated(name: str) -> RankedCandidate:
    return RankedCandidate(name, {}, None, None, None, None, "could not be simulated")


@dataclass(eq=False)
class VerdictReport:
    """Puts the diagnosis together from what was decided."""

    machine: Machine
    search: EffectSetSearch
    stands: Standing
    fitted: Sequence[Experiment]
    held: Sequence[Experiment]
    recordings: Sequence[str]
    seed: int
    tick: Callable[[str], None]
    fault: str
    prior: NominalPrior | None
    beside: str

    def __post_init__(self) -> None:
        d, self.objection = self.stands.decision, self.stands.objection
        self.decision = d = replace(d, kind="unknown") if self.objection else d
        #: Whether nothing was sought, for no experiment can be trusted.
        self.faulty = bool(self.fault) and d.kind == "unknown" and d.best is None
        self.residuals = d.residuals
        #: The machine without any effect.
        self.alone = self.search.found.fits[frozenset()]
        self.named = d.best if d.kind in ("effect", "ambiguous") else None
        self.use = self.named.use if self.named else []

    def diagnosis(self, silent: list[str], groups: list[list[str]]) -> Diagnosis:
        """All of it."""
        d = self.decision
        self.tick("measuring what is left")
        before = self.stands.before
        after = self.stands.after if self.named else before
        band = self.search.found.band.limit
        noise = noise_there(self.held, after, self.residuals.noise[0], band)
        was, now = errors(self.held, before), errors(self.held, after)
        begun = self.stands.begun if self.named else None
        still = rms(np.concatenate([e.speed for e in self.held]))
        blind = d.kind == "none" and was.rmse >= still
        off = d.kind == "none" and unlike(self.machine, self.alone, self.fitted, self.held, noise)
        # Of an unknown cause no set is in force: what one that was rejected moved says nothing.
        whole = self._completed(self.named or self.alone)
        moved = beyond(self.prior, whole, d.left, d.excess)
        strained = d.kind == "none" and bool(moved)
        if blind or off or strained:  # no better than a shaft that stands still, or not everywhere
            d = self.decision = replace(d, kind="unknown")
        was_fitted, now_fitted = self._of_fitted()
        part, _ = closed(self.held, before, after, noise)
        every = [*before, *was_fitted], [*after, *now_fitted], noise
        interval = further_interval(
            part, [*self.held, *self.fitted], *every, len(self.held), self.seed
        )
        angles = begun if self.named and now.rmse >= was.rmse else None
        if d.kind == "none" or angles:  # no gap, or no free run that could promise anything
            part, interval = None, None
        part = determined(part, interval)
        by = regimes(self.held, before, after, noise) if d.kind != "none" else []
        gap = Gap(noise, was, now, part, interval, by)
        where = self._where()
        fitted = amounts(whole, d.left, d.excess) if self.named else {}
        found = undetermined(with_masses(self.machine, fitted), self.named, d.alike)
        left = share(d.left / d.excess) if d.kind != "none" and d.excess > 0 else None
        acting = d.acting if self.named else []
        effects = list(dict.fromkeys(n for group in acting for n in group))
        spent = self.search.spent
        refit = self._refit(whole, before, noise)
        told = (left, angles, spent, closing(refit))
        words = sentence(self.machine.name, d.kind, acting, found, gap, where, *told)
        if self.objection and d.best:
            words = not_standing(d.best.names, gap, where, self.objection)
        words = not_seen(gap, still) if blind else off or words
        if not blind and (at_the_end(self.alone) if off else strained):
            words = STRAINED
        if d.kind == "none":
            words = enough(self.machine, refit, was.rmse) or words
        elif self.named is None and not self.faulty and self.search.found.speed_shows:
            words = f"{words} {as_calibrated(self.machine, was.rmse)}".rstrip()
        sure = self.named is not None or d.kind == "none" or strained
        far = said(self.machine, refit, moved, was.rmse) if refit and sure else ""
        far = far or (beside_effects(refit) if self.named else "")
        words = " ".join(w for w in (words, far) if w)
        if self.fault:
            words = not_measured(self.fault, "" if self.faulty else words)
        over = (begun[1] if begun and self.named else now).rmse / noise
        grounds = all_grounds(d.grounds, acting, over, bool(self.objection))
        best = d.best.use if d.best else []
        sought = d.kind != "none" and not self.faulty
        units = misread(self.machine, self.held, was, noise) if sought else ""
        units = units or counted_speed(found, self.held)
        depends = []
        if d.structured:
            torque = residual_torque(self.residuals, best, d.best.starts if d.best else None)
            depends = depends_on(self.residuals, torque)
        return Diagnosis(
            machine=self.machine.name,
            recordings=list(self.recordings),
            experiments={
                "fit": sorted({e.number for e in self.fitted}),
                "held_out": sorted({e.number for e in self.held}),
            },
            verdict=Verdict(d.kind, effects, acting, confidence(d.kind, grounds), words, grounds),
            gap=gap,
            where=where,
            candidates=[*self._ranked(found, before, noise), *self._nominal_row(refit)],
            remainder=Remainder(left, d.structured, depends),
            undetectable=[name for name in silent if name not in effects],
            ambiguities=self._all_groups(groups, acting),
            next_experiment=self._next(),
            refit=refit,
            notes=self._notes(units),
            effects=_told(self.machine, self.use),
            alternatives=[_told(self.machine, f.use) for f in d.alike[1:] if self.named],
            seen=_seen([*self.fitted, *self.held]),
            shown=[
                *map(self._drawn, self.held, repeat(True), before, after),
                *map(self._drawn, self.fitted, repeat(False), was_fitted, now_fitted),
            ],
            machine_file=self.machine.source,
        )

    def _of_fitted(self) -> tuple[list[Array], list[Array]]:
        """(L,) free runs of each fitted experiment, without the effects and with them."""
        was = [free_run(self.machine, e) for e in self.fitted]
        now = [free_run(self.machine, e, self.use) for e in self.fitted] if self.use else was
        return was, now

    def _refit(self, whole: EffectFit, before: Sequence[Array], noise: float) -> list[Refit]:
        """The machine's own parameters, as the set in force has them; alone without one."""
        if self.prior is None or self.faulty:
            return []
        after = [free_run(self.machine, e, self.alone.use) for e in self.held]
        part, _ = closed(self.held, before, after, noise)
        d = self.decision
        return refits(self.prior, whole, d.left, d.excess, part)

    def _completed(self, fitted: EffectFit) -> EffectFit:
        """A set with all that is uncertain of the machine file, for the width of its intervals."""
        if self.prior is None:
            return fitted
        return with_all(self.search.found.residuals, fitted, self.prior)

    def _where(self) -> list[GapLocation]:
        """By what was named, free of noise, or else by all that is wrong."""
        if self.decision.kind == "none" or self.faulty:
            return []
        none = self.alone.use
        if self.named is None:
            return places(residual_torque(self.residuals, none))
        found = added_torque(self.residuals, none, self.use, self.named.starts)
        return [*places(found), *steady_places(found, self.use)]

    def _notes(self, units: str) -> list[str]:
        cut = {e.number for e in self.fitted} & {e.number for e in self.held}
        parts = "cut into parts, some of them"
        few = f"fewer than {FEWEST_EXPERIMENTS} experiments: each was {parts}"
        if len({e.number for e in (*self.fitted, *self.held)}) >= FEWEST_EXPERIMENTS:
            few = f"long experiments were {parts}"
        odd = ((e.number, speed_doubt(self.machine, e)) for e in [*self.fitted, *self.held])
        first = next((f"experiment {n}: sensor or machine? {w}" for n, w in odd if w), "")
        last = "the machine file's numbers moved as far as it lets them: something else is missing"
        same = "held out: of other voltages than theirs nothing is promised"
        scale = OWN_SCALE if self.machine.calibration.get("equivalent") else ""
        ends = last if self.named is not None and at_the_end(self.named) else ""
        more = self._may_act_too()
        early = self.search.spent and self.decision.kind != "none"
        limit = "the search ended at its limit of work: other sets of effects were not tried"
        other = as_well(self.named, self.decision.alike)
        fewer = as_fewer(self.search.found, self.named) if self.named else ""
        cuts = f"{few} {same}" if cut else ""
        told = [cuts, self.beside, units, first, ends, scale, more, other, fewer]
        known = {effect.name: values for effect, values in self.machine.effects}
        told += [grown(e, known[e.name], given) for e, given in self.use if e.name in known]
        return [note for note in (*told, limit if early else "") if note]

    def _may_act_too(self) -> str:
        """What a law that departs may explain as well as an effect that leaves noise alone."""
        if self.named is None:
            return ""
        found, band = self.search.found, self.search.found.band
        limit = band.speed_limit(THRESHOLDS.remainder_false_alarm)
        if band.speed_excess(self.named.residual) <= THRESHOLDS.plainly_structured * limit:
            return ""
        mine = frozenset(self.named.names)
        more = [
            sorted(names - mine)
            for names, f in found.fits.items()
            if mine < names and not f.ended and band.speed_excess(f.residual) <= limit
        ]
        if not more:
            return ""
        fewest = min(len(names) for names in more)
        further = " and ".join(map(spoken, min(n for n in more if len(n) == fewest)))
        return f"with {further} as well only noise is left: it may act too, or a law be inexact"

    def _all_groups(
        self, computed: Sequence[Sequence[str]], acting: Sequence[Sequence[str]]
    ) -> list[list[str]]:
        found = [sorted(group) for group in acting if len(group) > 1]
        return found + [list(g) for g in computed if not any(set(g) <= set(f) for f in found)]

    def _next(self) -> NextExperiment | None:
        if len(self.decision.alike) < 2:
            return None
        self.tick("looking for the experiment that settles it")
        return next_experiment(self.residuals, self.decision.alike, self.seed)

    def _ranked(
        self,
        found: Mapping[str, Mapping[str, ParameterAmount]],
        before: Sequence[Array],
        noise: float,
    ) -> list[RankedCandidate]:
        d, explained = self.decision, self.search.found
        shares = shapley_shares(self.search, self.named) if self.named else {}
        ranked = []
        for c in self.search.candidates:
            only = frozenset([c.name])
            alone = explained.fits.get(only) or explained.scouted.get(only)
            rmse = part = score = None
            parameters = found.get(c.name, {})
            if alone is not None:
                after = [free_run(self.machine, e, alone.use) for e in self.held]
                part, _ = closed(self.held, before, after, noise)
                rmse = errors(self.held, after).rmse
                if not math.isfinite(rmse):
                    ranked.append(_unsimulated(c.name))
                    continue
                whole = alone.residual.size == self.residuals.size
                base = explained.base if whole else explained.responses.base
                band = explained.band if whole else self.search.band
                power = max(band.excess(base), float(base @ base) - alone.loss)
                score = share(1 - band.excess(alone.residual) / power) if power > 0 else None
                if not parameters:
                    left = max(band.excess(alone.residual), 0.0)
                    parameters = amounts(alone, left, max(power, 0.0))[c.name]
            elif not self.residuals.can_simulate([(c.effect, c.typical)]):
                ranked.append(_unsimulated(c.name))
                continue
            ranked.append(
                RankedCandidate(
                    c.name,
                    parameters,
                    rmse,
                    None if d.kind == "none" else part,
                    share(shares[c.name]) if c.name in shares else None,
                    score,
                    self._why_not(c.name, score),
                )
            )
        effects = [n for group in (d.acting if self.named else []) for n in group]

        def order(r: RankedCandidate) -> tuple[int, float]:
            place = effects.index(r.effect) if r.effect in effects else len(effects)
            return place, -(r.score if r.score is not None else -np.inf)

        return sorted(ranked, key=order)

    def _nominal_row(self, refit: Sequence[Refit]) -> list[RankedCandidate]:
        """What the machine file's own numbers close by themselves, as one candidate."""
        if not refit or not self.alone.own:
            return []
        d, band = self.decision, self.search.found.band
        moved = {}
        if self.prior:
            moved = self.prior.among(self.alone.own_columns).factors(self.alone.z[-1])
        amount = {name: ParameterAmount(factor, "", None) for name, factor in moved.items()}
        after = errors(
            self.held, [free_run(self.machine, e, self.alone.use) for e in self.held]
        ).rmse
        file = band.excess(self.search.found.residuals.of())
        score = share(1 - band.excess(self.alone.residual) / file) if file > 0 else None
        reason = None if d.kind == "none" else "leaves more than the noise within the tolerances"
        part = refit[0].closed_fraction
        return [RankedCandidate(NOMINAL, amount, after, part, None, score, reason)]

    def _why_not(self, name: str, score: float | None) -> str | None:
        d = self.decision
        if d.kind == "none":
            return "there is no gap to explain"
        if self.named and any(name in group for group in d.acting):
            return None
        if self.faulty:
            return "not tried: the sensor is faulty"
        if self.objection and d.best and name in d.best.names:
            return self.objection
        if score is None or score < THRESHOLDS.told_of_gap:
            return "explains nothing of the gap"
        if d.kind == "unknown":
            return f"leaves {1 - score:.0%} of the fitted gap"
        best = " and ".join(d.best.names) if d.best else ""
        return f"leaves {1 - score:.1%} of the fitted gap, {best} {share(d.left / d.excess):.1%}"

    def _drawn(self, e: Experiment, held_out: bool, before: Array, after: Array) -> DrawnExperiment:
        turn = TorqueEstimator(self.residuals.values["J"], self.residuals.memory, e.period, len(e))
        return DrawnExperiment(
            e,
            held_out,
            before,
            after,
            turn.of(np.nan_to_num(e.speed - before)),
            turn.of(np.nan_to_num(e.speed - after)),
            turn.smooth(e.speed),
            turn.smooth(e.speed, 1),
        )
