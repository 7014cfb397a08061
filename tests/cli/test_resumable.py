"""What is said of work that is interrupted: what is kept, if anything is."""

from __future__ import annotations

import click
import pytest

from ldt_core.base.settings import resolve
from ldt_core.cli import invoke
from ldt_core.cli.progress import ResumableProgress
from ldt_core.restart.run_key import command_to_resume


@pytest.mark.parametrize(
    ("done", "said"),
    [
        (0, ""),
        (3, " after 3 of 12 results, which are kept in out; go on with: ldt study --seeds 2"),
    ],
)
def test_what_is_kept_is_said_if_anything_is(done, said, capsys):
    """Before the first result the folder may not even be there."""

    @click.command("study")
    @click.option("--seeds")
    def study(seeds):
        with ResumableProgress("study", "results", "out") as progress:
            progress.show(done, 12)
            raise KeyboardInterrupt

    assert invoke(study, ["--seeds", "2"]) == 130
    assert capsys.readouterr().err == f"\nldt: interrupted{said}\n"


def test_the_command_that_goes_on_repeats_what_a_recording_may_not_name():
    """A file, code, and when things happen; the rest is recorded."""
    given = {"machine": "my press.yaml", "model": "linear", "seed": 3, "rate": "40", "bag": "run"}
    asked = command_to_resume(resolve(given), "my run")
    assert asked == "ldt run --resume 'my run' --machine 'my press.yaml' --rate 40"
