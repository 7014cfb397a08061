"""Work among threads that somebody interrupts."""

from __future__ import annotations

import threading
import time

import pytest

from ldt_core.base.threads import spread

SLICE = 0.005  # s, of each piece of work


def test_the_order_is_that_of_the_numbers():
    """However many threads there are."""
    for workers in (1, 3):
        assert list(spread(lambda k: k * k, 20, workers)) == [k * k for k in range(20)]


@pytest.mark.parametrize("where", ["waiting", "between"])
def test_what_is_interrupted_ends_inside_of_its_threads_too(where):
    """Each of them spreads further: a hundred pieces one after the other, in many rounds."""
    done, begun = [], threading.Event()

    def inner(_):
        begun.set()
        time.sleep(SLICE)
        done.append(1)
        if where == "waiting" and len(done) > 5:
            raise KeyboardInterrupt

    def outer(_):
        for _ in range(100):
            list(spread(inner, 100, 1))

    def consume():
        results = spread(outer if where == "waiting" else inner, 1000, 2)
        try:
            for _ in results:
                raise KeyboardInterrupt
        finally:
            results.close()

    with pytest.raises(KeyboardInterrupt):
        consume()
    count = len(done)
    time.sleep(20 * SLICE)
    assert begun.is_set()
    assert len(done) == count < 50
