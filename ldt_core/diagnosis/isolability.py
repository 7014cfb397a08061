"""What a recording can show and tell apart, from its input alone, before any of it is explained.

Every effect is simulated at its typical size on the recording's own voltages. One that moves
nothing beyond noise could not have been seen. One that another effect, fitted to it, imitates to
within noise could not have been told from that one, and the other way round.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ldt_core.diagnosis.candidate import Candidate
from ldt_core.diagnosis.effect_fit import fit
from ldt_core.diagnosis.effect_set_search import EffectSetSearch
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.responses import Responses
from ldt_core.diagnosis.thresholds import THRESHOLDS

SIMILAR_RESPONSES = 0.995  # cosine of two responses from which an imitation is worth a fit
IMITATED_EXPERIMENTS = 3  # on which imitations are fitted: a few show the input's kinds
IMITATION_STEPS = 6  # least-squares steps: a good imitation starts close
IMITATION_PRECISION = 1e-3  # of the loss, where it ends: what imitates ends at nearly nothing


def isolability(search: EffectSetSearch) -> tuple[list[str], list[list[str]]]:
    """(effects that do not show, groups that look alike), by the recording's input alone."""
    few = search.scout
    small = few.part(range(min(IMITATED_EXPERIMENTS, len(few.pieces))))
    scale = search.residuals.size / small.size
    silent = _undetectable(small, search.candidates, scale)
    return silent, _ambiguities(small, search.responses, silent, scale)


def _undetectable(
    residuals: FreeRunResiduals, candidates: Sequence[Candidate], scale: float
) -> list[str]:
    """Effects whose typical size moves nothing that could be seen."""
    base = residuals.of()
    found = []
    for c in candidates:
        moved = base - residuals.of([(c.effect, c.typical)])
        if float(moved @ moved) * scale < THRESHOLDS.visible_change:
            found.append(c.name)
    return found


def _ambiguities(
    residuals: FreeRunResiduals, responses: Responses, silent: Sequence[str], scale: float
) -> list[list[str]]:
    """Groups of effects that imitate each other to within noise, on this input."""
    candidates = responses.candidates
    loud = [i for i, c in enumerate(candidates) if c.name not in silent]
    truths: dict[int, FreeRunResiduals] = {}

    def imitates(j: int, i: int) -> bool:
        """Whether candidate j, fitted to i, leaves nothing beyond noise."""
        mine, theirs = (np.flatnonzero(responses.owner == k) for k in (i, j))
        block = responses.cosine[np.ix_(mine, theirs)]
        if not block.size or block.max() < SIMILAR_RESPONSES:
            return False
        start = responses.z[theirs[int(np.argmax(block.max(axis=0)))]]
        if i not in truths:
            truths[i] = _made(residuals, candidates[i])
        steps, precision = IMITATION_STEPS, IMITATION_PRECISION
        copy = fit(truths[i], [candidates[j]], [start], steps=steps, precision=precision)
        return copy.loss * scale < THRESHOLDS.indistinguishable_loss

    groups: list[set[int]] = []
    for i, j in itertools.combinations(loud, 2):
        if any({i, j} <= group for group in groups):
            continue
        if imitates(j, i) and imitates(i, j):
            joined = {i, j}.union(*(g for g in groups if g & {i, j}))
            groups = [*(g for g in groups if not g & joined), joined]
    return [sorted(candidates[i].name for i in g) for g in groups]


def _made(residuals: FreeRunResiduals, candidate: Candidate) -> FreeRunResiduals:
    """The residuals of noise-free experiments of a machine that has the effect."""
    use = [(candidate.effect, candidate.typical)]
    made = []
    for i, e in enumerate(residuals.experiments):
        speed, current = residuals.outputs(i, use, follow=False)
        made.append(replace(e, speed=speed, current=None if e.current is None else current))
    known = residuals.machine, made, residuals.noise, residuals.workers
    return FreeRunResiduals(*known, running=residuals.running)
