"""A machine that nothing explains is searched ever more rarely."""

from __future__ import annotations

import itertools

from ldt_core.twin.search_backoff import LONGEST, SearchBackoff


def searches(backoff, experiments):
    found = []
    for number in range(1, experiments + 1):
        backoff.saw(explained=False, error=1.0)
        if backoff.due:
            found.append(number)
            backoff.failed(1.0)
    return found


def test_a_search_that_fails_doubles_the_wait():
    """Up to the longest."""
    found = searches(SearchBackoff(), 400)
    gaps = [b - a for a, b in itertools.pairwise(found)]
    assert gaps[:6] == [1, 2, 4, 8, 16, 32]
    assert max(gaps) == LONGEST


def test_what_is_explained_ends_the_waiting():
    """The next change is searched at once."""
    backoff = SearchBackoff()
    searches(backoff, 20)
    backoff.saw(explained=True, error=0.1)
    assert backoff.due
    assert searches(backoff, 4) == [1, 2, 4]


def test_an_error_that_grew_is_searched_at_once():
    """And is no news when it comes again."""
    backoff = SearchBackoff()
    searches(backoff, 20)
    assert not backoff.due
    backoff.saw(explained=False, error=4.0)
    assert backoff.due
    backoff.failed(4.0)
    backoff.saw(explained=False, error=4.5)  # the first wait
    backoff.failed(4.5)
    backoff.saw(explained=False, error=4.5)
    assert not backoff.due


def test_a_state_goes_on_alike():
    """After a restart."""
    backoff, again = SearchBackoff(), SearchBackoff()
    searches(backoff, 9)
    again.return_to(backoff.state())
    assert searches(again, 50) == searches(backoff, 50)
