"""What is said of work that is interrupted: what is kept, if anything is."""

from __future__ import annotations

import pytest

from ldt_core.cli.progress import ResumableProgress


@pytest.mark.parametrize(
    ("done", "said"),
    [(0, ""), (3, "3 of 12 results are kept in out; the same command goes on from there\n")],
)
def test_what_is_kept_is_said_if_anything_is(done, said, capsys):
    """Before the first result the folder may not even be there."""
    progress = ResumableProgress("study", "results", "out")
    progress.show(done, 12)
    with pytest.raises(KeyboardInterrupt), progress:
        raise KeyboardInterrupt
    assert capsys.readouterr().err == said
