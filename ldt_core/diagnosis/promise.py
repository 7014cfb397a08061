"""What every further effect promises beside a set, by the responses, before anything is fitted."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from ldt_core.diagnosis.candidate import Candidate
from ldt_core.diagnosis.search import SHRINK, STRETCH, Dictionary, Fit
from ldt_core.diagnosis.trials import Bench

Array = NDArray[np.float64]


class Promises:
    """Of the effects whose responses are known.

    Args:
        scout: bench that the responses are of.
        responses: of all candidates at their starts.
    """

    def __init__(self, scout: Bench, responses: Dictionary) -> None:
        self.scout, self.responses = scout, responses

    def ranked(self, base: Fit) -> list[tuple[Candidate, Array, float]]:
        """Every other effect with its most promising values beside a set, and what they promise."""
        d = self.responses
        left, moved = base.rest, d.responses
        if base.members:
            span = np.linalg.qr(base.jacobian)[0]
            moved = moved - (moved @ span) @ span.T
            left = left - span @ (span.T @ left)
        size, target = np.einsum("ij,ij->i", moved, moved), moved @ left
        scale = np.clip(target / np.maximum(size, 1e-9), SHRINK, STRETCH)
        gain = 2 * scale * target - scale**2 * size
        for group in self._phases:
            gain[group], scale[group] = self._at_any_angle(moved[group], left)
        chosen: dict[int, int] = {}
        for k in np.argsort(-gain):
            owner = int(d.owner[k])
            if d.candidates[owner].name not in base.names:
                chosen.setdefault(owner, int(k))
        return [
            (d.candidates[i], d.candidates[i].scaled(d.z[k], float(scale[k])), float(gain[k]))
            for i, k in chosen.items()
        ]

    @functools.cached_property
    def turned(self) -> frozenset[str]:
        """Effects whose phase each experiment may choose, since start angles are not known."""
        d = self.responses
        return frozenset(d.candidates[int(d.owner[group[0]])].name for group in self._phases)

    @functools.cached_property
    def _phases(self) -> list[NDArray[np.int64]]:
        """Places of responses that differ by a phase alone, if start angles are not known."""
        d, found = self.responses, []
        if all(p.rest for p in self.scout.pieces):
            return []
        for i, c in enumerate(d.candidates):
            own = np.flatnonzero(d.owner == i)
            other = [j for j, p in enumerate(c.parameters) if p.unit != "rad"]
            if len(other) == len(c.parameters) or not self.scout.angular([c.effect]):
                continue
            same: dict[bytes, list[int]] = {}
            for k in own:
                same.setdefault(d.z[k][other].tobytes(), []).append(int(k))
            found += [np.array(group) for group in same.values()]
        return found

    def _at_any_angle(self, moved: Array, left: Array) -> tuple[float, float]:
        """(promise, how many times as strong) of an effect whose phase each experiment may choose.

        Args:
            moved: (phases, size) responses that differ by the phase alone.
            left: (size,) residuals.
        """
        gain = size = 0.0
        for piece in self.scout.pieces:
            part = moved[:, piece.rows]
            power, along = np.linalg.eigh(part @ part.T)
            kept = along[:, -2:][:, power[-2:] > 1e-9 * max(power[-1], 1e-300)]  # a sine, a cosine
            onto = kept.T @ (part @ left[piece.rows])
            gain += float(np.sum(onto**2 / power[-2:][-kept.shape[1] :])) if onto.size else 0.0
            size += float(power.sum()) / power.size
        scale = float(np.clip(np.sqrt(gain / max(size, 1e-9)), SHRINK, STRETCH))
        return gain, scale
