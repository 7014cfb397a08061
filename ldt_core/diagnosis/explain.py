"""The sets of effects that explain a recording best, one, two and three at a time.

A scout works on a few experiments: every effect alone, then the pairs and triples that the
responses' inner products promise, each fitted. Its best sets of every size are fitted again on all
experiments.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.threads import spread
from ldt_core.diagnosis.candidate import Candidate
from ldt_core.diagnosis.energy import Band
from ldt_core.diagnosis.explained import Explained, Names
from ldt_core.diagnosis.model_selection import HALF, LITTLE, earned, plain_enough
from ldt_core.diagnosis.promise import Promises
from ldt_core.diagnosis.search import (
    Fit,
    best_alone,
    ceiling,
    fit,
    rank_pairs,
    simulate_all,
)
from ldt_core.diagnosis.starts import Starts
from ldt_core.diagnosis.trials import Bench

Array = NDArray[np.float64]

SCOUT_SAMPLES = 12_000  # of the experiments that the scout works on, and
SCOUT_EXPERIMENTS = 8  # at most so many of them
MOST = 6  # effects in a set
TRIPLE = 3  # effects, up to which sets are tried even where the last one did not help
PAIRS = 5  # fitted because their responses promise most
BASES = 3  # sets of one size that are built upon
ADDED = 3  # effects added to each of them, and as many again
NEXT_TO = 0.5  # if they promise this part of what the best of them does
RIVALS = 6  # effects that may take the place of one in the chosen set,
CLOSE = 0.7  # if they promise this part of what the best promises
KEPT = 4  # sets of each size that are fitted on all experiments, and
PLAIN = 2  # more that are further behind, but have fewer parameters
HOPELESS = 0.5  # of the gap: if all effects together explain no more, no set of them will
HOPEFUL = 0.3  # of the gap: where a set leaves more, an effect is tried with it only if it promises
PROMISE = 0.1  # to take away this part of that
PROMISED = 0.7  # of what an effect explains that its response alone promises, at worst
QUICK = 8  # steps of the scout's fits, and
ROUGH = 1e-4  # of the sum of squares: the scout's fits end there
MANY = 3  # parameters, with which a fit may not have reached its best, and
UNSURE = 0.005  # of the gap that it then leaves: it goes on, for
PATIENT = 30  # steps
NEAR = 1.5  # times what the best of its size leaves, that a set may leave more, to be kept
CLEAR = 30.0  # fall of the sum of squares that chance does not reach, over all sets that are tried


class Try(NamedTuple):
    """A set of effects, where its fit is to begin, and the start states that are nearly its own."""

    members: Sequence[Candidate]
    start: Sequence[Array]
    known: Starts | None = None


class Search:
    """The search on one bench.

    Args:
        bench: experiments to explain.
        candidates: effects that may explain them.
        tick: called with what is being done.
        own: the machine's own parameters that are not known for certain: they are fitted with
            every set, and never named.
    """

    def __init__(
        self,
        bench: Bench,
        candidates: Sequence[Candidate],
        tick: Callable[[str], None] = lambda doing: None,
        own: Sequence[Candidate] = (),
    ) -> None:
        self.bench, self.candidates, self.tick = bench, tuple(candidates), tick
        self.own = tuple(own)
        #: Effect to those that this recording cannot tell from it, whatever the data are.
        self.twins: dict[str, set[str]] = {}
        # Its fits run side by side: over so few experiments each of them could not be spread well.
        self.scout, self.workers = bench.part(scouted(bench), workers=1), bench.workers
        zeros = [np.zeros(len(c)) for c in self.own]
        count = len(self.own)
        fitted = fit(self.scout, self.own, zeros, own=count) if own else None
        responses = simulate_all(
            self.scout,
            self.candidates,
            lambda: tick("simulating effects"),
            fitted,
            self.workers,
        )
        alone = fit(bench, self.own, fitted.z, own=count) if fitted else _empty(bench)
        self.found = Explained(bench, Band(bench), alone.rest, self.scout, responses)
        self.promises = Promises(self.scout, responses)
        # Without any effect: the machine's own parameters alone.
        self.found.fits[frozenset()] = alone
        self.found.scouted[frozenset()] = fitted or _empty(self.scout)
        self.band = Band(self.scout)

    def run(self) -> Explained:
        """Fit sets of one effect, then of two and three as long as something is left.

        Larger sets are built only on a triple that a pair could not replace.
        """
        enough = self.band.limit_of(0.01)
        self._alone()
        bases = BASES
        most = MOST if ceiling(self.found.responses) > HOPELESS else 1
        for count in range(1, most + 1):
            if count == 2:
                self._pairs()
            if count > 1:
                self._build_on(count - 1, bases)
            self._finish(count)
            best = self._best(count)
            if not best or self.band.excess(best[0].rest) < enough or self._explained(best[0]):
                break
            if count > 1 and not self._gained(count):
                bases = 1
            if count >= TRIPLE and not self._gained(count):
                break
        return self.found

    def _explained(self, best: Fit) -> bool:
        """Whether so little of the speed's gap is left that no further effect would be named.

        What lies above the band, such as a ripple, is judged by what the effects promise.
        """
        band, none = self.band, self.found.scouted[frozenset()]
        left = max(band.speed_excess(best.rest), 0.0)
        taken = float((band.speed_loss(none.rest) - band.speed_loss(best.rest)).sum())
        gap = max(taken, 0.0) + left
        return left < LITTLE * gap and not any(
            gain > CLEAR and earned(best.effects, [*best.effects, c], gain / PROMISED, left, gap)
            for c, _, gain in self.promises.ranked(best)
        )

    def _gained(self, count: int) -> bool:
        """Whether the best set of a size takes away half of what the best smaller one leaves."""
        now, before = self._best(count)[0], self._best(count - 1)[0]
        return before.loss - now.loss > HALF * max(self.band.excess(before.rest), 0.0)

    def _alone(self) -> None:
        tries = [
            Try([c], [start])
            for i, c in enumerate(self.candidates)
            for start in best_alone(self.found.responses, i)
        ]
        none = self.found.scouted[frozenset()]
        turned = self.promises.turned
        ranked = self.promises.ranked(none) if turned else ()
        self._scout([*tries, *(Try([c], [start]) for c, start, _ in ranked if c.name in turned)])

    def _pairs(self) -> None:
        ranked = sorted(rank_pairs(self.found.responses).items(), key=lambda q: -q[1][0])
        z, c = self.found.responses.z, self.candidates
        self._scout([Try([c[i], c[j]], [z[k], z[m]]) for (i, j), (_, k, m) in ranked[:PAIRS]])

    def _build_on(self, count: int, bases: int) -> None:
        tries = []
        for base in _of_each_kind(self._best(count))[:bases]:
            more = [*self.additions(base, ADDED), *self.additions(base, 2 * ADDED, NEXT_TO)]
            chosen = {c.name: (c, z) for c, z in more}.values()
            tries += [self._with(base, candidate, start) for candidate, start in chosen]
        self._scout(tries)

    def additions(self, base: Fit, count: int, close: float = 0.0) -> list[tuple[Candidate, Array]]:
        """Effects that promise most beside a set, with the values to begin with.

        Args:
            base: the set.
            count: of effects, at most.
            close: part of the best promise that each must reach.
        """
        enough = max(self.band.excess(base.rest), 0.0)
        start = self.found.scouted[frozenset()].loss
        promise = PROMISE * enough if enough > HOPEFUL * start else 0.0
        ranked = self.promises.ranked(base)
        best = ranked[0][2] if ranked else 0.0
        enough_for = [(c, z) for c, z, gain in ranked if gain >= max(promise, close * best)]
        # Where each experiment may choose an angle, a ripple promises more than it can keep.
        turned = self.promises.turned
        kept = [(c, z) for c, z in enough_for if c.name not in turned][:count]
        return [(c, z) for c, z in enough_for[:count] if c.name in turned] + kept

    def _with(self, base: Fit, candidate: Candidate, start: Array) -> Try:
        """A scouted set and one more effect.

        The start angles are sought beside those of the set, but not where the effect depends on
        them more than the machine does itself.
        """
        if self.scout.shaking:
            turned = any(p.unit == "rad" for p in candidate.parameters)
        else:
            turned = self.scout.angular([candidate.effect])
        members = [*base.effects, candidate]
        known = None if turned else base.starts
        return Try(members, [*base.z[: len(base.effects)], start], known)

    def _scout(self, tries: Sequence[Try]) -> list[Fit]:
        """Fit sets on a few experiments, side by side; the best of each set so far."""
        none = self.found.scouted[frozenset()]

        def work(k: int) -> Fit:
            members, start, known = tries[k]
            order = sorted(range(len(members)), key=lambda i: members[i].name)
            return fit(
                self.scout,
                [*(members[i] for i in order), *self.own],
                [*(start[i] for i in order), *none.z],
                evaluations=QUICK,
                precision=ROUGH,
                own=len(self.own),
                known=known,
            )

        names = []
        for tried in spread(work, len(tries), self.workers):
            self.tick("fitting sets of effects")
            names.append(frozenset(tried.names))
            before = self.found.scouted.get(names[-1])
            if before is None or tried.loss < before.loss:
                self.found.scouted[names[-1]] = tried
        return [self.found.scouted[n] for n in names]

    def _best(self, count: int) -> list[Fit]:
        found = [f for names, f in self.found.scouted.items() if len(names) == count]
        return sorted(found, key=lambda f: f.loss)

    def _finish(self, count: int) -> None:
        """Fit the scout's best sets of a size on all experiments."""
        best = self._best(count)
        if not best:
            return
        near = [f for f in best if self._near(f, best[0])][:KEPT]
        plain = [f for f in best if f not in near and self._plainer(f, best[0])][:PLAIN]
        for f in (*near, *plain):
            self.finish(f)

    def _near(self, scouted: Fit, best: Fit) -> bool:
        behind = scouted.loss - best.loss
        return behind <= NEAR * max(self.band.excess(best.rest), 0.0) + CLEAR

    def _plainer(self, scouted: Fit, best: Fit) -> bool:
        """Whether a set with fewer parameters might be preferred to another one."""
        gap = self.found.scouted[frozenset()].loss - best.loss
        return plain_enough(scouted, best, scouted.loss - best.loss, gap)

    def finish(self, scouted: Fit) -> Fit:
        """The same set, fitted on all experiments."""
        names = frozenset(scouted.names)
        if names not in self.found.fits:
            self.tick("fitting the best sets on all experiments")
            if self.scout.size == self.bench.size:
                self.found.fits[names] = scouted
            else:
                self.found.fits[names] = fit(
                    self.bench, scouted.members, scouted.z, own=len(self.own)
                )
            self._polish(names)
        return self.found.fits[names]

    def _polish(self, names: Names) -> None:
        """Go on with a fit that may have ended before its many parameters were at their best.

        Not with one that is far behind another of its size.
        """
        found, band = self.found.fits[names], self.found.band
        left, whole = band.excess(found.rest), self.found.excess
        best = min(self.found.of_size(len(names)), key=lambda f: f.loss, default=found)
        behind = found.loss - best.loss > NEAR * max(band.excess(best.rest), 0.0) + CLEAR
        if found.free < MANY or behind or not UNSURE * whole < left < HOPEFUL * whole:
            return
        more = fit(
            self.bench,
            found.members,
            found.z,
            evaluations=PATIENT,
            own=len(self.own),
            known=found.starts,
        )
        self.found.fits[names] = min(found, more, key=lambda f: f.loss)

    def subset(self, base: Fit, names: Sequence[str]) -> Fit:
        """A part of a set, fitted on all experiments."""
        wanted = frozenset(names)
        if wanted not in self.found.scouted:
            chosen = [i for i, m in enumerate(base.effects) if m.name in wanted]
            self._scout([Try([base.members[i] for i in chosen], [base.z[i] for i in chosen])])
        return self.finish(self.found.scouted[wanted])

    def alternatives(self, base: Fit, count: int = RIVALS) -> list[Fit]:
        """Sets that differ from a set in one member, the most promising, fitted on all."""
        tries = []
        for leave in range(len(base.effects)):
            members = [m for j, m in enumerate(base.effects) if j != leave]
            z = [base.z[j] for j in range(len(base.effects)) if j != leave]
            known = self.found.scouted.get(frozenset(m.name for m in members))
            rest = self._scout([Try(members, z)])[0] if known is None else known
            twins = self.twins.get(base.effects[leave].name, ())
            tried = self.additions(rest, count + 1, CLOSE)
            tried += [(c, z) for c, z, _ in self.promises.ranked(rest) if c.name in twins]
            for candidate, start in tried:
                if candidate.name not in base.names:
                    tries.append(self._with(rest, candidate, start))
        return self._worth(base, self._scout(tries))

    def _worth(self, base: Fit, found: Iterable[Fit]) -> list[Fit]:
        scouted = self.found.scouted.get(frozenset(base.names), base)
        return [
            self.finish(f) for f in found if self._near(f, scouted) or self._plainer(f, scouted)
        ]


def _of_each_kind(fits: Sequence[Fit]) -> list[Fit]:
    """The first of those sets that consist of effects of the same families."""
    first: dict[Names, Fit] = {}
    for f in fits:
        first.setdefault(frozenset(c.effect.family or c.name for c in f.effects), f)
    return list(first.values())


def _empty(bench: Bench) -> Fit:
    rest = bench.rest()
    return Fit((), (), rest, np.zeros((rest.size, 0)), float(rest @ rest))


def scouted(bench: Bench) -> list[int]:
    """Places of the experiments that the scout works on, spread evenly over the recording."""
    sizes = [p.rows.stop - p.rows.start for p in bench.pieces]
    count = max(1, min(SCOUT_EXPERIMENTS, int(SCOUT_SAMPLES // max(np.mean(sizes), 1))))
    count = min(count, len(sizes))
    return sorted({round(i) for i in np.linspace(0, len(sizes) - 1, count)})
