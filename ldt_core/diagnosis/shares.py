"""What each member of a set explains: its Shapley share, a mean over all orders of adding them."""

from __future__ import annotations

import itertools

from ldt_core.diagnosis.explain import Search
from ldt_core.diagnosis.search import Fit


def shapley(search: Search, fit: Fit) -> dict[str, float]:
    """Each member's share of what the set takes off the sum of squares; they sum to 1.

    Every subset is fitted on all experiments, if it has not been. Shapley, A value for n-person
    games (1953).
    """
    if len(fit.names) == 1:
        return {fit.names[0]: 1.0}
    found = search.found
    worth: dict[frozenset[str], float] = {frozenset(): 0.0}
    start = float(found.base @ found.base)
    for count in range(1, len(fit.names) + 1):
        for names in itertools.combinations(fit.names, count):
            worth[frozenset(names)] = start - search.subset(fit, names).loss
    whole = worth[frozenset(fit.names)]
    shares = dict.fromkeys(fit.names, 0.0)
    orders = list(itertools.permutations(fit.names))
    for order in orders:
        for k, name in enumerate(order):
            gain = worth[frozenset(order[: k + 1])] - worth[frozenset(order[:k])]
            shares[name] += gain / whole / len(orders)
    return shares
