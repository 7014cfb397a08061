"""Linear algebra on one thread: several split their sums by their number, hence other last bits."""

from __future__ import annotations

import functools
from contextlib import AbstractContextManager

import scipy.linalg  # noqa: F401  loads the libraries that are to be limited
from threadpoolctl import ThreadpoolController


@functools.cache
def _controller() -> ThreadpoolController:
    # Finding the loaded libraries takes 3 ms, a tenth of a training.
    return ThreadpoolController()


def one_thread() -> AbstractContextManager[object]:
    """All linear algebra inside runs on one thread, in numpy and scipy alike."""
    return _controller().limit(limits=1)
