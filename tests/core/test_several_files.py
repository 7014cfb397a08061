"""Claims about a file per record: files become one recording, or are refused by name."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from ldt_core.base.errors import BadInput
from ldt_core.cli import invoke, ldt
from ldt_core.recording.bag import experiments, read_bag
from ldt_core.recording.health import inspect
from ldt_core.recording.importers import import_files

COUNT = 60
FIELDS = {"voltage": "u", "speed": "n", "time": "t"}
TYPED = ["--voltage=u:V", "--speed=n:rad/s", "--time=t:s"]


def record(path: Path, seed: int, begin: float = 0.0, period: float = 0.1, head="t,u,n") -> str:
    """A logger's file; no two seeds give the same speeds."""
    noise = np.random.default_rng(seed)
    times = begin + period * np.arange(COUNT)
    rows = [f"{t:.6f},{k % 7},{noise.normal():.4f}" for k, t in enumerate(times)]
    path.write_text("\n".join([head, *rows]) + "\n")
    return str(path)


@pytest.fixture
def files(tmp_path: Path) -> list[str]:
    return [record(tmp_path / f"r{k}.csv", k) for k in range(1, 4)]


def test_each_file_gives_the_experiments_that_it_gives_alone(files, tmp_path, capsys):
    """In the order given, numbered on; none has samples of two files."""
    turned = files[::-1]
    out = str(tmp_path / "out")
    assert invoke(ldt, ["import", *turned, *TYPED, "--length", "2.5", "--out", out]) == 0
    told = capsys.readouterr().out
    assert f"{files[2]}: 60 rows, experiments 1 to 2\n" in told
    assert f"{files[0]}: 60 rows, experiments 5 to 6\n" in told
    assert told.count("voltage from 'u' in V") == 1  # not once a file
    together = experiments(out).experiments
    alone = []
    for k, file in enumerate(turned):
        part = str(tmp_path / f"part{k}")
        assert invoke(ldt, ["import", file, *TYPED, "--length", "2.5", "--out", part]) == 0
        alone += experiments(part).experiments
    assert [e.number for e in together] == [1, 2, 3, 4, 5, 6]
    assert [e.speed.tolist() for e in together] == [e.speed.tolist() for e in alone]


def test_times_that_begin_anew_in_each_file_follow_each_other(files, tmp_path):
    """So that nothing in the recording goes backwards."""
    out = str(tmp_path / "out")
    assert invoke(ldt, ["import", *files, *TYPED, "--length", "2.5", "--out", out]) == 0
    health = inspect(read_bag(out))
    assert not health.backwards
    starts = [e.start for e in experiments(out).experiments]
    assert starts == pytest.approx([0, 2.5, 5, 7.5, 10, 12.5])


def test_times_that_say_when_a_file_was_recorded_are_kept(tmp_path):
    """Also where one file goes on right behind the other."""
    begins = (1e9, 1e9 + 6.0, 1e9 + 100)
    files = [record(tmp_path / f"r{k}.csv", k, begin) for k, begin in enumerate(begins)]
    made = [read.experiments[0] for read in import_files(files, **FIELDS)]
    assert [e.start for e in made] == pytest.approx(begins, abs=1e-6)


def test_clocks_that_differ_a_little_give_one_period(tmp_path):
    """One model has one period; another rate is refused, unless --sample-period makes it one."""
    files = [record(tmp_path / f"r{k}.csv", k, period=p) for k, p in enumerate((0.1, 0.1001))]
    first, second = (read.experiments[0] for read in import_files(files, **FIELDS))
    assert first.period == second.period == 0.1
    files[1] = record(tmp_path / "half.csv", 1, period=0.2)
    told = f"half.csv: expected samples 0.1 s apart, as in {files[0]} (or --sample-period), got 0.2"
    with pytest.raises(BadInput, match=re.escape(told)):
        list(import_files(files, **FIELDS))
    made = [read.experiments[0] for read in import_files(files, **FIELDS, sample_period=0.2)]
    assert [e.period for e in made] == [0.2, 0.2]


OTHER = {
    "another name": ("t,u,speed", {}, "r2.csv, column: expected one of 'speed', 't', 'u'"),
    "another name in its place": ("t,u,speed", {"speed": "3"}, "expected 'n', as in"),
    "another unit": ("t,u,n\n1,1,rpm", {"speed": "n:rad/s"}, "'n', as in {first}, got 'n' in rpm"),
    "no names": (None, {"speed": "3", "voltage": "2", "time": "1"}, "got column 2 of 3 without"),
    "shorter than the length": ("t,u,n", {"length": 7.0}, "r1.csv: expected a stretch of 7 s"),
    "an option that suits none": ("t,u,n", {"length": 0.1}, "r1.csv, --length: expected"),
}


@pytest.mark.parametrize("fault", OTHER)
def test_a_file_that_is_not_like_the_first_is_refused_by_name(files, fault):
    """With what the first one has."""
    head, options, words = OTHER[fault]
    if head is None:
        Path(files[1]).write_text(Path(files[1]).read_text().partition("\n")[2])
    else:
        record(Path(files[1]), 2, head=head)
    with pytest.raises(BadInput) as caught:
        list(import_files(files, **{**FIELDS, **options}))
    assert words.format(first=files[0]) in str(caught.value)


@pytest.mark.parametrize("earlier", [False, True])
def test_where_a_later_file_is_refused_nothing_is_made(files, tmp_path, capsys, earlier):
    """An earlier recording stays as it was, with --force too."""
    out = tmp_path / "out"
    if earlier:
        assert invoke(ldt, ["import", files[0], *TYPED, "--out", str(out)]) == 0
    Path(files[2]).write_text("t,u,n\n0,1,2\n1,off,2\n")
    capsys.readouterr()
    assert invoke(ldt, ["import", *files, *TYPED, "--out", str(out), "--force"]) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"ldt: {files[2]}, line 3, column 'u': expected a finite number")
    assert out.exists() is earlier
    if earlier:
        assert len(experiments(out).experiments) == 1
    assert sorted(p.name for p in tmp_path.glob(".*")) == []


def test_a_program_learns_which_file_an_experiment_is_from(files, tmp_path, capsys):
    """In the JSON of the import."""
    assert invoke(ldt, ["import", *files[:2], *TYPED, "--out", str(tmp_path / "x"), "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert [(part["file"], part["experiments"]) for part in record["files"]] == [
        (files[0], [1, 1]),
        (files[1], [2, 2]),
    ]
    assert record["experiments"] == 2
