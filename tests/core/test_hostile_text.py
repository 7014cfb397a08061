"""Whatever a recording holds: no command obeys its texts or follows its paths.

What pages make of such texts is tested with each page.
"""

from __future__ import annotations

import io
import json
import re
import shutil
from pathlib import Path

import click
import pytest
import yaml
from fake_run import fake_run
from rich.table import Table

from ldt_core.base.experiment import Action, Adaptation, Level, Signal
from ldt_core.base.metrics import Summary
from ldt_core.base.printable import one_line, printable
from ldt_core.cli import invoke, ldt
from ldt_core.cli.console import Console
from ldt_core.cli.progress import RunProgress, print_summaries
from ldt_core.cli.terminal import echo
from ldt_core.recording.writer import BagWriter

#: Clears the screen, writes a title, hides what follows, goes up a line, rings, turns the writing
#: round, and begins lines of its own; what rich would take for its markup; HTML.
HOSTILE = (
    "\x1b[2J\x1b]0;owned\x07\x1b[8m\x1b[1A\x9b2K\r\x08\u202eok\u2028\nok  all is well\nldt: done "
    "[red]x[/] [/nothing] </script><img src=x onerror=alert(1)>\"' {{ 7*7 }} <!-- \udc80"
)
OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")
SENDABLE = HOSTILE.replace("\udc80", "")  # a message is UTF-8


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """A run in whose texts all of it stands."""
    return fake_run(tmp_path_factory.mktemp("hostile") / "run", words=SENDABLE)


def shown(capsys: pytest.CaptureFixture[str]) -> str:
    """What a command has printed, in which nothing is obeyed and no line is forged."""
    printed = capsys.readouterr()
    both = printed.out + printed.err
    assert not OBEYED.search(both), OBEYED.findall(both)
    forged = [line for line in both.splitlines() if line.startswith(("ok  all is", "ldt: done"))]
    assert forged == []
    return both


# ---- terminals


def test_what_a_terminal_would_obey_is_shown_instead():
    """And all else is left as it is."""
    assert printable(HOSTILE).count("\\x1b") == 4
    assert not OBEYED.search(printable(HOSTILE))
    printable(HOSTILE).encode()
    plain = "Größe 2·π, 温度, \t100 %\n"
    assert printable(plain) == plain
    assert "\n" not in one_line(HOSTILE)


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments",
    [
        ["doctor"],
        ["report", "-o", "page.html"],
        ["plot", "--out", "run.png"],
        ["replay", "--out", "again", "--model", "physics"],
        ["advise"],
        ["predict", "--machine", "rotor", "--out", "predicted"],
    ],
    ids=lambda a: a[0],
)
def test_no_command_obeys_a_recording(arguments, run, tmp_path, monkeypatch, capsys):
    """Whether it can use it or not."""
    monkeypatch.chdir(tmp_path)
    name, *options = arguments
    assert invoke(ldt, [name, str(run), *options]) in (0, 1, 2)
    assert shown(capsys)


def test_no_command_obeys_the_names_of_topics(tmp_path, monkeypatch, capsys):
    """Nor those of files that are not there, in a recording that says it has them."""
    monkeypatch.chdir(tmp_path)
    for number, topics in enumerate(
        ([f"/{SENDABLE}/experiment"], ["/a/experiment", f"/{SENDABLE}/experiment"])
    ):
        folder = tmp_path / f"bag{number}"
        with BagWriter(folder, "rig") as writer:
            for topic in topics:
                writer.write_raw(topic, "std_msgs/msg/Float64MultiArray", b"\0" * 8, 1)
        info = yaml.safe_load((folder / "metadata.yaml").read_text())
        info["rosbag2_bagfile_information"]["relative_file_paths"].append(f"{SENDABLE}.mcap")
        (folder / "metadata.yaml").write_text(yaml.safe_dump(info))
        for command in ("doctor", "report"):
            invoke(ldt, [command, str(folder), *(["-o", "x.html"] if command == "report" else [])])
            assert shown(capsys)


def test_an_error_s_sentence_is_one_line(capsys):
    """Of whatever was typed, or stands in a file."""
    for words in (
        ["doctor", HOSTILE],
        [HOSTILE],
        ["run", "--model", HOSTILE],
        ["run", f"--{HOSTILE}"],
    ):
        assert invoke(ldt, words) == 2
        assert shown(capsys).count("\n") == 1


def test_the_summary_and_the_progress_obey_nothing(capsys, monkeypatch):
    """On a terminal, where colours are wanted and are ours."""
    summary = Summary()
    summary.add_signal(Signal(1, Level.NEGATIVE, HOSTILE, 0, 1.0))
    summary.add_adaptation(Adaptation(1, Action.KEPT, 0, HOSTILE))
    summary.note(HOSTILE, f"again {HOSTILE}")
    settings = {"model": HOSTILE, "detector": HOSTILE}
    print_summaries([(HOSTILE, summary, "")], settings, False)
    assert "\\x1b[2J" in shown(capsys)
    print_summaries([(f"{HOSTILE} {n}", summary, "") for n in range(5)], settings, False)
    assert "\\x1b[2J" in shown(capsys)
    print_summaries([(HOSTILE, summary, "")], settings, True)
    assert json.loads(shown(capsys))["runs"][0]["machine"] == HOSTILE
    screen = io.StringIO()
    monkeypatch.setattr(
        "ldt_core.cli.progress.Console",
        lambda **_: Console(file=screen, force_terminal=True, width=300),
    )
    with RunProgress({HOSTILE: 1}) as progress:
        progress.show(
            HOSTILE, Signal(1, Level.NEGATIVE, "a", 0, 1.0), Adaptation(1, Action.KEPT, 0, "")
        )
    drawn = screen.getvalue()
    assert "\\x1b[2J" in drawn
    assert "\x1b[2J" not in drawn
    assert "\u202e" not in drawn


def test_rich_and_click_keep_their_own_colours():
    """What is ours is not touched."""
    screen = io.StringIO()
    table = Table(title="[bold]t[/]")
    table.add_row(f"a{HOSTILE}".replace("[", "("))
    console = Console(file=screen, force_terminal=True, color_system="standard", width=200)
    console.print(table, markup=True)
    assert "\x1b[1" in screen.getvalue()
    assert "\x1b(2J" not in screen.getvalue()
    assert click.unstyle(screen.getvalue()).count("\\x1b") == 4


def test_nothing_of_ours_prints_past_it():
    """Commands print by `echo` and our console; where click's own is used the text is cleaned."""
    own = {"completion.py", "docs.py", "terminal.py", "console.py"}  # a shell's program, our pages
    found = []
    for file in sorted((Path(echo.__code__.co_filename).parent).glob("*.py")):
        for line in file.read_text().splitlines():
            direct = re.search(r"click\.s?echo\(|(?<![\w.])print\(|from rich\.console import", line)
            safe = "json.dumps" in line or "one_line" in line or "printable" in line
            if direct and not safe and file.name not in own:
                found.append(f"{file.name}: {line.strip()}")
    assert found == ['doctor.py: click.echo(f"{grade} {finding.name:{width}}  {sentence}")']


# ---- paths


def test_a_recording_reaches_no_file_outside_its_folder(tmp_path, capsys):
    """By paths up or absolute in metadata.yaml, and by links."""
    secret = fake_run(tmp_path / "secret", machine="confidential")
    (file,) = secret.glob("*.mcap")
    for number, path in enumerate(
        (f"../secret/{file.name}", str(file), "/etc/passwd", "../../etc/passwd")
    ):
        bag = fake_run(tmp_path / f"bag{number}", machine="open")
        info = yaml.safe_load((bag / "metadata.yaml").read_text())
        info["rosbag2_bagfile_information"]["relative_file_paths"] = [path]
        (bag / "metadata.yaml").write_text(yaml.safe_dump(info))
        (own,) = bag.glob("*.mcap")
        if own.name == file.name:
            own.rename(bag / "other.mcap")
        invoke(ldt, ["doctor", str(bag), "--json"])
        told = capsys.readouterr().out
        assert "machine open" in told
        assert "confidential" not in told
        assert "root:" not in told
    linked = tmp_path / "linked"
    linked.mkdir()
    (linked / "linked_0.mcap").symlink_to(file)
    shutil.copy(secret / "metadata.yaml", linked)
    assert invoke(ldt, ["doctor", str(linked)]) == 2
    assert "a file of the recording's own folder" in capsys.readouterr().err


# ---- programs


@pytest.mark.parametrize(
    "program",
    [
        "!!python/object/apply:os.system ['touch {}']",
        "!!python/object/new:subprocess.Popen [['touch', '{}']]",
        "!!python/name:os.system",
        "__import__('os').system('touch {}')",
    ],
)
def test_nothing_that_is_read_is_run(program, tmp_path, capsys):
    """In bag information, machine files, files of settings, and keys of those."""
    trace = tmp_path / "trace"
    program = program.format(trace)
    bag = fake_run(tmp_path / "bag")
    (bag / "metadata.yaml").write_text(f"rosbag2_bagfile_information:\n  custom_data: {program}\n")
    files = {"machine": f"name: {program}\n", "settings": f"seed: {program}\n"}
    for name, text in files.items():
        (tmp_path / f"{name}.yaml").write_text(text)
    for words in (
        ["doctor", str(bag)],
        ["report", str(bag), "-o", str(tmp_path / "x.html")],
        ["run", "--machine", str(tmp_path / "machine.yaml"), "--experiments", "1"],
        ["run", "--settings", str(tmp_path / "settings.yaml"), "--experiments", "1"],
    ):
        invoke(ldt, words)
        assert "Traceback" not in capsys.readouterr().err
        assert not trace.exists()
