"""A recording that is deleted, renamed or replaced while it is written."""

from __future__ import annotations

import shutil
import time

import pytest

from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment
from ldt_core.recording.bag import read_bag
from ldt_core.recording.writer import FLUSH_PERIOD, BagWriter

PATIENCE = 40 * FLUSH_PERIOD  # s; a stalled machine is not what is tested


def experiment(number: int) -> Experiment:
    """A short one."""
    return Experiment(number, 1e9 + number, 0.01, [1.0, 2.0], [0.0, 0.5])


def deleted(folder):
    """As by `rm -r`."""
    shutil.rmtree(folder)


def renamed(folder):
    """As by `mv`."""
    folder.rename(folder.with_name("elsewhere"))


def replaced(folder):
    """By another one of the same name."""
    renamed(folder)
    shutil.copytree(folder.with_name("elsewhere"), folder)


def emptied(folder):
    """As by `truncate`, or a rotation of logs."""
    (folder / "run_0.mcap").write_bytes(b"")


@pytest.mark.parametrize("vanish", [deleted, renamed, replaced, emptied])
def test_that_it_vanished_is_said_within_a_moment_and_a_new_one_can_begin(vanish, tmp_path):
    """Without another message; writing, flushing and closing all say it."""
    writer = BagWriter(tmp_path / "run", "rotor")
    writer.write("experiment", experiment(1), 1e9)
    writer.flush()
    vanish(tmp_path / "run")
    began = time.monotonic()
    while writer.failure is None and time.monotonic() - began < PATIENCE:
        time.sleep(FLUSH_PERIOD)
    words = "run: the file or its folder was deleted or renamed while it was written"
    if vanish is emptied:
        words = "run: somebody else cut the file short while it was written"
    for use in (lambda: writer.write("experiment", experiment(2), 1e9), writer.flush, writer.close):
        with pytest.raises(LdtError, match=words):
            use()
    if vanish is replaced:
        return
    with BagWriter(tmp_path / "run", "rotor", resume=True, once=True) as new:
        new.write("experiment", experiment(2), 1e9)
    assert [e.number for e in read_bag(tmp_path / "run").experiments()] == [2]


def test_that_it_vanished_is_said_at_the_end_as_well(tmp_path):
    """Between the last look and the end."""
    writer = BagWriter(tmp_path / "run", "rotor")
    writer.write("experiment", experiment(1), 1e9)
    writer._closed.set()  # the flusher looks no more
    for thread in writer._threads:
        thread.join()
    writer._closed.clear()
    deleted(tmp_path / "run")
    with pytest.raises(LdtError, match="deleted or renamed"):
        writer.close()
    assert not (tmp_path / "run").exists()
