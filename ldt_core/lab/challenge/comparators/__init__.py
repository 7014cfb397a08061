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

#: Comparators by name, and what they are.
COMPARATORS: dict[str, Comparator] = {
    "greedy": greedy,
    "aic": akaike,
    "bic": bayes,
    "sparse_regression": sparse_regression,
    "gaussian_process": gaussian_process,
}
WORDS = {
    "greedy": "adds one effect at a time as long as the held-out error falls (one-error rule)",
    "aic": "single effects and pairs fitted in free run, the least AIC of white residuals",
    "bic": "the same, the least BIC",
    "sparse_regression": "PySINDy's STLSQ on the residual torque, threshold by cross-validation",
    "gaussian_process": "the hybrid model's Gaussian process learns the gap and names nothing",
}

__all__ = ["COMPARATORS", "WORDS", "compare"]
