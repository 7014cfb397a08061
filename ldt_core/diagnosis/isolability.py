"""What a recording can show and tell apart, from its input alone, before any of it is explained.

Every effect is simulated at its typical size on the recording's own voltages. One that moves
nothing beyond noise could not have been seen. One that another effect, fitted to it, imitates to
within noise could not have been told from that one, and the other way round.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ldt_core.diagnosis.candidate import Candidate
from ldt_core.diagnosis.search import Dictionary, fit
from ldt_core.diagnosis.trials import Bench

SEEN = 25.0  # sum of squares, in noise deviations, that a visible effect moves
ALIKE = 10.8  # that an imitation leaves at most: chi-square of one degree, p = 0.001
RELATED = 0.995  # cosine of two responses from which an imitation is worth a fit
EXPERIMENTS = 3  # on which imitation is tried
EVALUATIONS = 6  # of one imitation


def undetectable(bench: Bench, candidates: Sequence[Candidate], scale: float = 1.0) -> list[str]:
    """Effects whose typical size moves nothing that could be seen.

    Args:
        bench: a part of the experiments.
        candidates: effects.
        scale: samples of all experiments over those of the bench.
    """
    base = bench.rest()
    found = []
    for c in candidates:
        moved = base - bench.rest([(c.effect, c.typical)])
        if float(moved @ moved) * scale < SEEN:
            found.append(c.name)
    return found


def ambiguities(
    bench: Bench, responses: Dictionary, silent: Sequence[str], scale: float = 1.0
) -> list[list[str]]:
    """Groups of effects that imitate each other to within noise, on this input.

    Args:
        bench: a few experiments.
        responses: of all candidates, for which pairs are worth a fit.
        silent: effects that do not show.
        scale: samples of all experiments over those of the bench.
    """
    candidates = responses.candidates
    loud = [i for i, c in enumerate(candidates) if c.name not in silent]
    imitates: set[tuple[int, int]] = set()
    for i in loud:
        mine = np.flatnonzero(responses.owner == i)
        truth: Bench | None = None
        for j in loud:
            theirs = np.flatnonzero(responses.owner == j)
            if i == j or mine.size == 0 or theirs.size == 0:
                continue
            block = responses.cosine[np.ix_(mine, theirs)]
            if block.max() < RELATED:
                continue
            start = responses.z[theirs[int(np.argmax(block.max(axis=0)))]]
            truth = truth or _made(bench, candidates[i])
            copy = fit(truth, [candidates[j]], [start], evaluations=EVALUATIONS)
            if copy.loss * scale < ALIKE:
                imitates.add((i, j))
    mutual = {(i, j) for i, j in imitates if (j, i) in imitates}
    groups: list[set[int]] = []
    for i, j in sorted(mutual):
        joined = {i, j}
        for group in [g for g in groups if g & joined]:
            groups.remove(group)
            joined |= group
        groups.append(joined)
    return [sorted(candidates[i].name for i in g) for g in groups]


def _made(bench: Bench, candidate: Candidate) -> Bench:
    """The bench with noise-free experiments of a machine that has the effect."""
    use = [(candidate.effect, candidate.typical)]
    made = []
    for i, e in enumerate(bench.experiments):
        speed, current = bench.outputs(i, use, follow=False)
        made.append(replace(e, speed=speed, current=None if e.current is None else current))
    return Bench(bench.machine, made, bench.noise, bench.workers)
