"""Results kept in files: found again only as they were written, and never half written."""

from __future__ import annotations

import contextlib
import errno
import json
import os
from pathlib import Path

import pytest

from ldt_core.base.digest import file_digest
from ldt_core.base.errors import OptionError
from ldt_core.base.result_files import (
    check_target,
    check_writable,
    keep,
    recall,
    whole,
    write,
)

ORIGIN = {"code": "abc", "options": {"seed": 0}, "left_out": None}


@pytest.fixture
def kept(tmp_path):
    """A record, a result, and a page beside it."""
    record, found, page = (tmp_path / "new" / n for n in ("r.run.json", "r.json", "r.html"))
    keep(record, found, "{}\n", "one-1", ORIGIN, {"seconds": 2.5}, {page: "<p>"})
    return record, found, page


def test_what_was_kept_comes_back_with_what_was_noted(kept):
    """The folder is made; nothing but the three files is left in it."""
    record, found, page = kept
    assert recall(record, found, "one-1", ORIGIN) == ("{}\n", {"seconds": 2.5})
    assert page.read_text() == "<p>"
    assert set(record.parent.iterdir()) == set(kept)


def test_another_origin_format_or_content_is_not_used(kept):
    """Nor a record that is none."""
    record, found, _ = kept
    assert recall(record, found, "one-1", {**ORIGIN, "code": "abd"}) is None
    assert recall(record, found, "one-2", ORIGIN) is None
    found.write_text("{ }\n")
    assert recall(record, found, "one-1", ORIGIN) is None
    found.write_text("{}\n")
    assert recall(record, found, "one-1", ORIGIN) is not None
    for text in ("", "[]", "1", "{}", "[" * 100_000, json.dumps({"format": "one-1"})):
        record.write_text(text)
        assert recall(record, found, "one-1", ORIGIN) is None
    record.unlink()
    assert recall(record, found, "one-1", ORIGIN) is None


def test_an_interrupted_second_writing_leaves_no_answer(kept, monkeypatch):
    """The old record does not fit the new result, so that neither is used."""
    record, found, page = kept

    def fails(path, text):
        if path == page:
            raise KeyboardInterrupt
        write(path, text)

    monkeypatch.setattr("ldt_core.base.result_files.write", fails)
    with pytest.raises(KeyboardInterrupt):
        keep(record, found, '{"a": 1}\n', "one-1", ORIGIN, beside={page: "<b>"})
    assert recall(record, found, "one-1", ORIGIN) is None


def test_a_file_is_written_whole_or_stays_as_it_was(tmp_path):
    """What fails in the middle: the old text is there, and no other file."""
    file = tmp_path / "a.txt"
    write(file, "old")
    with contextlib.suppress(OSError), whole(file) as part:
        part.write_text("new")
        raise OSError
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


def test_a_digest_changes_with_bytes_and_names(tmp_path):
    """Of files in folders below as well; nothing has a digest of its own."""
    folder = tmp_path / "case"
    (folder / "inner").mkdir(parents=True)
    (folder / "inner" / "a").write_bytes(b"1")
    seen = {file_digest(folder)}
    (folder / "inner" / "a").rename(folder / "a")
    seen.add(file_digest(folder))
    (folder / "a").write_bytes(b"2")
    seen |= {file_digest(folder), file_digest(folder / "a"), file_digest(tmp_path / "none")}
    assert len(seen) == 4
    assert file_digest(folder) == file_digest(folder / "a")


def test_a_full_disk_is_told_with_the_file(tmp_path, monkeypatch):
    """The system says that there is no room, and not where."""

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OSError, match=r"page\.html"):
        write(tmp_path / "page.html", "text")
    assert not list(tmp_path.iterdir())


def test_a_name_that_is_no_text_can_be_written(tmp_path):
    """A page names its recording, whose name may hold any bytes."""
    write(tmp_path / "page.html", os.fsdecode(b"run\xff"))
    assert (tmp_path / "page.html").read_text() == "run\\udcff"


def test_a_device_is_not_replaced():
    """Under a user that may, a result took the place of /dev/null."""
    with pytest.raises(OptionError, match="a device or a pipe"):
        check_target("/dev/null")


@pytest.mark.parametrize("file", ["/proc/run.html", "/sys/kernel/run.html"])
def test_a_place_that_takes_no_file_is_refused_before_the_work(file):
    """Root may write everywhere, and still cannot there."""
    with pytest.raises(OptionError, match=r"a folder that can be written to, got /"):
        check_target(file)


def test_nothing_is_left_of_asking(tmp_path):
    """A folder that does not exist is not made either."""
    check_writable(tmp_path / "a" / "b")
    check_target(tmp_path / "run.html")
    assert list(tmp_path.iterdir()) == []
