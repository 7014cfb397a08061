"""Which kinds of cases a challenge has, and in which order: the order tells nothing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ldt_core.lab.challenge.laws import LAWS, OUTSIDE

#: Shares of the kinds of cases, in percent.
SHARES = {"none": 15, "single": 45, "pair": 15, "triple": 5, "outside": 20}
ORDER, EFFECTS, CASE = range(3)  # independent random streams of a challenge


@dataclass(frozen=True)
class Order:
    """A case to be made.

    Args:
        name: of its folder.
        kind: none, single, pair, triple or outside.
        effects: that must act in it; the others of a set are drawn.
        seed: of all that is random in it.
        left_out: effect that the diagnosis is to do without, or None.
        samples: in each experiment.
    """

    name: str
    kind: str
    effects: tuple[str, ...]
    seed: tuple[int, ...]
    left_out: str | None = None
    samples: int = 2000


def orders(cases: int, seed: int, leave_one_out: bool = False, samples: int = 2000) -> list[Order]:
    """The cases of a challenge, shuffled.

    Args:
        cases: how many.
        seed: of the challenge.
        leave_one_out: single effects only, each left out of the library by turns.
        samples: in each experiment.
    """
    counts = {"single": cases} if leave_one_out else _counts(cases)
    turns = {kind: _in_turn(kind, seed) for kind in counts}
    wanted = [(kind, next(turns[kind])) for kind, count in counts.items() for _ in range(count)]
    shuffled = np.random.default_rng(np.random.SeedSequence([seed, ORDER])).permutation(cases)
    return [
        Order(
            name=f"case_{number:04d}",
            kind=wanted[index][0],
            effects=wanted[index][1],
            seed=(seed, CASE, number),
            left_out=wanted[index][1][0] if leave_one_out else None,
            samples=samples,
        )
        for number, index in enumerate(shuffled, start=1)
    ]


def _counts(cases: int) -> dict[str, int]:
    """Cases of each kind: the shares, what is left over to the largest remainders."""
    exact = {kind: cases * share / 100 for kind, share in SHARES.items()}
    counts = {kind: int(number) for kind, number in exact.items()}
    behind = sorted(counts, key=lambda kind: counts[kind] - exact[kind])
    for kind in behind[: cases - sum(counts.values())]:
        counts[kind] += 1
    return counts


def _in_turn(kind: str, seed: int) -> Iterator[tuple[str, ...]]:
    """Each effect once in a random order, then once again in another one, and so on."""
    known: Sequence[str] = sorted(OUTSIDE if kind == "outside" else LAWS)
    stream = list(SHARES).index(kind)
    random = np.random.default_rng(np.random.SeedSequence([seed, EFFECTS, stream]))
    while True:
        for name in random.permutation(known):
            yield () if kind == "none" else (str(name),)
