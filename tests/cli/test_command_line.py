"""The command line as a habit: every report as JSON, slips understood, names completed."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

import msgs_config
from ldt_core.cli import SECTIONS, invoke, ldt
from ldt_core.detectors import DETECTORS
from ldt_core.effects import EFFECTS
from ldt_core.models import MODELS

BIN = Path(sys.executable).parent
RUN = Path(__file__).resolve().parents[2] / "bags" / "rotor_drift"
NO_REPORT = {"completion"}  # prints a program for a shell


def commands(group: click.Group = ldt, path: str = "") -> Iterator[tuple[str, click.Command]]:
    """All commands that do something, by what is typed for them."""
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        if isinstance(command, click.Group):
            yield from commands(command, f"{path}{name} ")
        else:
            yield path + name, command


ALL = dict(commands())


@pytest.mark.parametrize("name", ALL)
def test_a_command_reports_as_json_and_shows_an_example(name):
    """`--json` is a flag of each; so is an example in each help text."""
    flags = {flag: p for p in ALL[name].params for flag in p.opts}
    if name not in NO_REPORT:
        assert flags["--json"].is_flag
    assert f"ldt {name} " in f"{' '.join((ALL[name].help or '').split())} "
    for flag in flags:
        if flag.startswith("-"):
            assert flag == flag.lower()
            assert "_" not in flag


def test_the_list_of_commands_says_each_in_one_line_that_is_whole(capsys):
    """Each once, under what it is for; no line ends in dots, as click's would that is cut."""
    assert invoke(ldt, ["--help"]) == 0
    shown = capsys.readouterr().out.split("Options:\n")[1]
    headings = re.findall(r"^(\w[\w ]*):$", shown, flags=re.MULTILINE)
    assert headings == list(SECTIONS)
    lines = [line for line in shown.splitlines() if re.match(r"  \w", line)]
    assert sorted(line.split()[0] for line in lines) == ldt.list_commands(click.Context(ldt))
    assert [line for line in lines if not line.endswith(".") or line.endswith("...")] == []


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (
            "--model hybrid --order 2",
            "--order: expected --model linear or --model auto as well: "
            "it has no effect otherwise, got --model hybrid",
        ),
        ("--detector window --threshold 2", "--threshold: expected --detector threshold"),
        ("--advice-every 3", "--advice-every: expected --advice as well"),
        ("--preset paper --window 3", "--window: expected --detector window"),
        ("--model linear --order 2", ""),
        ("--order 2", ""),  # auto has linear models among its own
        ("--preset paper --threshold 2", ""),
        ("--model hybrid --no-offset", ""),  # as --preset paper has it
    ],
)
def test_an_option_that_does_nothing_here_is_refused(options, sentence, short_rotor, capsys):
    """In one sentence on standard error; an option that serves the choice is not."""
    given = ["--machine", short_rotor, "--experiments", "1", "--no-bag", *options.split()]
    assert invoke(ldt, ["run", *given]) == (2 if sentence else 0)
    said = capsys.readouterr().err
    assert said.startswith(f"ldt: {sentence}") if sentence else said == ""
    assert said.count("\n") == bool(sentence)


def test_what_ships_is_declared():
    """Whose options are known, so that one that changes nothing beside them is refused."""
    declared = msgs_config.parameters()
    for name, registry in (("model", MODELS), ("detector", DETECTORS)):
        assert sorted(declared[name]["shipped"]) == sorted(registry.builtin)


def test_help_is_short_and_says_where_the_rest_is(capsys):
    """No command lists more than 18 options at once; of those that have more, --help-all does."""
    for name, command in ALL.items():
        asked_first = click.Context(command)  # click keeps what it would be given here
        assert command.get_help_option(asked_first).opts == ["-h", "--help"], name
        assert invoke(ldt, [*name.split(), "--help"]) == 0
        options = capsys.readouterr().out.split("Options:\n")[1]
        listed = re.findall(r"^  (?:-\w, )?--[\w-]+", options, re.MULTILINE)
        assert len(listed) <= 18, name
        own = [p for p in command.params if "--help-all" not in p.opts]
        assert ("  --help-all" in listed) == (len(own) > 17), name
        for flag in ("--help-all", "-h"):
            assert invoke(ldt, [*name.split(), flag]) == 0
            assert capsys.readouterr().out.startswith("Usage: ldt")


def test_a_long_help_has_sections_and_says_what_a_flag_is_by_default(capsys):
    """Every option of `ldt up` is once under one heading; a flag that is on says so."""
    assert invoke(ldt, ["up", "--help-all"]) == 0
    sections = re.split(r"^(\w[^\n]*):$", capsys.readouterr().out, flags=re.MULTILINE)[1:]
    shown = dict(zip(sections[::2], sections[1::2], strict=True))
    assert {"Options", "Detector", "Simulated machine", "Graph"} <= set(shown)
    assert "--json" in shown["Options"]
    assert "--drift-level" in shown["Detector"]
    assert "[default: sensor-check]" in " ".join(shown["Adaptor"].split())
    listed = re.findall(r"^  (?:-\w, )?(--[\w-]+)", "".join(shown.values()), flags=re.MULTILINE)
    own = [p.opts[-1] for p in ALL["up"].params if "--help" not in p.opts]
    assert sorted(listed) == sorted([*own, "--help", "--help-all"])


def test_one_name_means_one_kind_of_thing():
    """A flag here is a flag everywhere; a number here is nowhere a word."""
    kinds: dict[str, dict[str, str]] = {}
    for name, command in ALL.items():
        for p in command.params:
            if isinstance(p, click.Option):
                kind = "flag" if p.is_flag else p.type.name.split(" ")[0]
                kind = {"choice": "text", "string": "text"}.get(kind, kind)
                for flag in p.opts:
                    kinds.setdefault(flag, {})[name] = kind
    plain = {"integer range": "integer", "float range": "float"}
    odd = {f: k for f, k in kinds.items() if len({plain.get(v, v) for v in k.values()}) > 1}
    assert odd == {}


def test_what_is_made_goes_where_o_says():
    """As everywhere: `-o` wherever there is `--out`."""
    for name, command in ALL.items():
        for p in command.params:
            if isinstance(p, click.Option) and "--out" in p.opts:
                assert p.opts == ["-o", "--out"], name


#: What goes on from what is there, and what is never replaced: sealed cases and keys.
NO_FORCE = {"study", "challenge score", "challenge make", "security init"}


def test_what_is_made_is_replaced_by_force_alone():
    """Every command that writes has --force, but for those that say why not."""
    lacking = set()
    for name, command in ALL.items():
        flags = {flag for p in command.params for flag in p.opts}
        if "--out" in flags and "--force" not in flags:
            lacking.add(name)
    assert lacking == NO_FORCE


# ---- JSON of the commands that make files


def reported(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict:
    assert invoke(ldt, [*arguments, "--json"]) == 0
    shown = capsys.readouterr().out
    assert shown.count("\n") == 1
    return json.loads(shown)


def test_simulate_import_and_plot_report_what_they_made(tmp_path, monkeypatch, capsys, short_rotor):
    """Where it is, and what is in it."""
    monkeypatch.chdir(tmp_path)
    made = ("--experiments", "2", "--effect", "unbalance:e=0.005", "--out", "bag")
    found = reported(capsys, "simulate", "--machine", short_rotor, *made)
    assert found["recording"] == "bag"
    assert (found["experiments"], found["samples"], found["machine"]) == (2, 200, "rotor")
    assert any("unbalance" in words for words in found["simulated"])
    Path("a.csv").write_text("t,u,n\n" + "".join(f"{k / 100},5,{k % 7}\n" for k in range(250)))
    fields = ("--voltage", "u", "--speed", "n:rpm", "--time", "t", "--length", "1")
    found = reported(capsys, "import", "a.csv", *fields, "--out", "imported")
    assert (found["experiments"], found["samples"]) == (2, 100)
    assert found["sample_period"] == pytest.approx(0.01)
    assert any("dropped" in note for note in found["notes"])
    pytest.importorskip("matplotlib")
    found = reported(capsys, "plot", str(RUN), "--out", "run.png", "--experiment", "7")
    assert found == {"figure": "run.png", "shown": 7, "experiments": 40}
    assert invoke(ldt, ["predict", "bag", "--machine", short_rotor, "--out", "predicted"]) == 0
    capsys.readouterr()
    assert reported(capsys, "plot", "predicted", "--out", "all.png")["shown"] == [1, 2]
    one = ("--out", "one.svg", "--experiment", "2", "--title", "A rotor")
    assert reported(capsys, "plot", "predicted", *one)["shown"] == [2]
    assert "A rotor" in Path("one.svg").read_text()
    assert Path("all.png").stat().st_size > 10_000
    assert invoke(ldt, ["plot", "predicted", "--out", "c.png", "--experiment", "9"]) == 2
    assert "one of 1 to 2 in predicted, got 9" in capsys.readouterr().err
    assert invoke(ldt, ["plot", "predicted", "--out", "c.txt"]) == 2
    assert invoke(ldt, ["report", "predicted", "--out", "c.html"]) == 2
    assert "ldt plot shows predictions alone" in capsys.readouterr().err


def test_challenge_make_reports_the_key_and_says_its_digest_first(monkeypatch, capsys):
    """The digest is published before any case is written, on stderr when stdout is for JSON."""

    def make(cases, seed, out, key, *, say, **_):
        say("abc")
        return Path("cases.key.json")

    monkeypatch.setattr("ldt_core.lab.challenge.make.make_challenge", make)
    arguments = ["challenge", "make", "--cases", "3", "--seed", "1", "--out", "cases", "--json"]
    assert invoke(ldt, arguments) == 0
    shown = capsys.readouterr()
    assert shown.err == "SHA-256 of the key: abc\n"
    expected = {"cases": 3, "out": "cases", "key": "cases.key.json", "sha256": "abc"}
    assert json.loads(shown.out) == expected


# ---- slips


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("simulat", "did you mean 'simulate'?"),
        ("doctr", "did you mean 'doctor'?"),
        ("challenge mak", "did you mean 'make'? commands are make, score"),
        ("challenge scroe", "did you mean 'score'?"),
        ("run --exp 3", "did you mean '--experiments'? (ldt run --help lists all)"),
        ("run --error_threshold 3", "did you mean '--error-threshold'?"),
        ("challenge make --leave-one", "did you mean '--leave-one-out'?"),
        ("run --no-colour", "there is no option '--no-colour'"),
        ("--verbose", "did you mean '--version'? (ldt --help lists all)"),
        ("tune bag --out o --detector lddmm", "did you mean 'lddm'?"),
        ("study --out o --only beter", "did you mean 'better'?"),
        ("completion fisch", "did you mean 'fish'?"),
    ],
)
def test_a_slip_is_understood(line, words, capsys):
    """One sentence with the nearest name, exit code 2."""
    assert invoke(ldt, line.split()) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.startswith("ldt: ")
    assert said.count("\n") == 1


# ---- completion


def completed(line: str, monkeypatch: pytest.MonkeyPatch, capsys) -> list[tuple[str, str]]:
    """(type, value) of what a shell is offered at the end of the line."""
    words = line.split(" ")
    monkeypatch.setenv("_LDT_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", line)
    monkeypatch.setenv("COMP_CWORD", str(len(words) - 1))
    with pytest.raises(SystemExit) as end:
        invoke(ldt, [])
    assert end.value.code == 0
    lines = capsys.readouterr().out.split()
    return [(kind, value) for kind, _, value in (entry.partition(",") for entry in lines)]


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("ldt s", ["security", "serve", "simulate", "study"]),
        ("ldt challenge ", ["make", "score"]),
        ("ldt run --mod", ["--model"]),
        ("ldt --h", ["--help"]),
        ("ldt run --machine ", ["dc_motor", "rotor"]),
        ("ldt predict bag --machine r", ["rotor"]),
        (
            "ldt run --model ",
            ["auto", "diagnosed", "grey_box", "hybrid", "linear", "physics", "remainder"],
        ),
        ("ldt replay bag --detector l", ["lddm"]),
        ("ldt tune bag --detector l", ["lddm"]),
        ("ldt run --degradation r", ["ramp", "repaired", "recurring"]),
        ("ldt simulate --effect cou", ["coulomb_friction"]),
        ("ldt diagnose bag --without coul", ["coulomb_friction"]),
        ("ldt effects unb", ["unbalance"]),
        ("ldt effects ", EFFECTS.names()),
        ("ldt completion ", ["bash", "zsh", "fish"]),
    ],
)
def test_names_are_completed(line, offered, monkeypatch, capsys):
    """Commands, options, choices, machines, models, detectors, effects."""
    found = completed(line, monkeypatch, capsys)
    assert found == [("plain", name) for name in offered]


@pytest.mark.parametrize("line", ["ldt replay my_", "ldt run --machine ./m", "ldt run --bag b"])
def test_files_are_offered_where_no_name_fits(line, monkeypatch, capsys):
    """A recording, a machine file of one's own."""
    assert completed(line, monkeypatch, capsys) == [("file", line.rpartition(" ")[2])]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_shell_gets_its_program(shell, capsys, monkeypatch):
    """It asks the `ldt` command, and both other shells are answered in their own way."""
    assert invoke(ldt, ["completion", shell]) == 0
    program = capsys.readouterr().out
    assert f"_LDT_COMPLETE={shell}_complete" in program
    monkeypatch.setenv("_LDT_COMPLETE", f"{shell}_complete")
    monkeypatch.setenv("COMP_WORDS", "ldt" if shell == "fish" else "ldt chall")
    monkeypatch.setenv("COMP_CWORD", "chall" if shell == "fish" else "1")
    with pytest.raises(SystemExit):
        invoke(ldt, [])
    assert "challenge" in capsys.readouterr().out


def test_bash_completes_by_the_program_as_it_is_printed(tmp_path):
    """In a real bash, with the installed command."""
    if not (shutil.which("bash") and (BIN / "ldt").exists()):
        pytest.skip("no bash, or ldt is not installed beside this Python")
    (tmp_path / "my_machine.yaml").write_text("")
    script = """
eval "$(ldt completion bash)"
offer() { COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMPREPLY=(); _ldt_completion ldt "${@: -1}" \
"${@: -2:1}" 2>/dev/null; echo "${COMPREPLY[*]}"; }
offer ldt cal
offer ldt run --model hyb
offer ldt simulate --effect coul
complete -p ldt
"""
    done = subprocess.run(
        ["bash", "--norc", "-c", script],
        env={**os.environ, "PATH": f"{BIN}:{os.environ['PATH']}"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    *offered, binding = done.stdout.splitlines()
    assert offered == ["calibrate", "hybrid", "coulomb_friction"]
    assert binding.endswith("_ldt_completion ldt")


def test_completion_imports_neither_ros_nor_numpy():
    """A shell waits for it at every press of the key."""
    code = (
        "import os, sys; os.environ.update(_LDT_COMPLETE='bash_complete', COMP_WORDS='ldt ',"
        " COMP_CWORD='1');\nfrom ldt_core.cli import main\ntry:\n    main([])\nfinally:\n"
        "    print(sorted({'rclpy', 'numpy', 'numba'} & set(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "plain,doctor" in done.stdout
    assert done.stderr == "[]\n"


@pytest.mark.parametrize(
    ("command", "default"),
    [
        ("run", "[default: rotor]"),
        ("replay", "[default: (that of the recording)]"),
        ("advise", "[default: (that of the recording, else rotor)]"),
    ],
)
def test_help_says_which_machine_is_taken(command, default, capsys):
    """That of a recording; and what is no option is not listed as one."""
    assert invoke(ldt, [command, "--help"]) == 0
    said = capsys.readouterr().out
    assert default in " ".join(said.split())
    assert "  RECORDING\n" not in said
