"""Other ways to name the cause of a gap, on the same cases and with the same library.

Each does what its practitioners would, as well as it can: the same experiments to fit, the same
free runs, bounds on signs where it has parameters, and its own criterion to stop. None of them says
"unknown", since none has a notion of it.
"""

from __future__ import annotations

from ldt_core.lab.challenge.comparators.compare import Comparator, compare
from ldt_core.lab.challenge.comparators.gaussian_process import gaussian_process
from ldt_core.lab.challenge.comparators.selection import akaike, bayes, greedy
from ldt_core.lab.challenge.comparators.sparse_regression import sparse_regression

COMPARATORS: dict[str, Comparator] = {
    "greedy": greedy,
    "aic": akaike,
    "bic": bayes,
    "sparse_regression": sparse_regression,
    "gaussian_process": gaussian_process,
}

__all__ = ["COMPARATORS", "compare"]
