"""`ldt diagnose` and `ldt predict --with`: files, keys, promises kept, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from ldt_core.base.experiment import Experiment
from ldt_core.cli import invoke, ldt, predict
from ldt_core.cli.diagnose import _row, command
from ldt_core.cli.simulate import command as simulate
from ldt_core.effects import EFFECTS, parse_effect
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.bag import read_bag
from ldt_core.recording.writer import BagWriter
from ldt_core.runs.each_recording import RecordingAnswer

#: Figures are drawn for this module's cases alone.
pytestmark = pytest.mark.usefixtures("in_one_layout", "undrawn")

ROTOR = load_machine("rotor")
TRIED = ("coulomb_friction", "viscous_friction", "inertia", "constant_load", "quadratic_drag")
BAD = 2

CUBIC_DRAG = """
from ldt_core.physics.effect import Effect
from ldt_core.physics.parameter import Parameter


def torque(t, theta, omega, current, voltage, p):
    return -p[0] * omega**3


CUBIC_DRAG = Effect(
    name="cubic_drag",
    description="drag that grows with the cube of the speed",
    equation="torque = -c omega^3",
    parameters=(
        Parameter("c", "N m s^3", low=0.0, default=0.0, description="coefficient", scale=1e-6),
    ),
    typical={"c": 1e-6},
    torque=torque,
)
"""


def record(folder, *effects, count=4, samples=500, volts=(-14.0, 14.0), noise=0.05):
    """Steps of voltage from rest."""
    random, use = np.random.default_rng(7), [parse_effect(e) for e in effects]
    physics, values = ROTOR.model, ROTOR.parameters
    with BagWriter(str(folder), machine="rotor") as writer:
        for number in range(1, count + 1):
            u = np.repeat(random.uniform(*volts, -(-samples // 60)), 60)[:samples]
            states = physics.simulate(values, u, 0.01, physics.initial_state(values, 0.0), use)
            speed = physics.measure(states, 0.01, use) + noise * random.standard_normal(samples)
            e = Experiment(number, 1e9 + 100.0 * number, 0.01, u, speed)
            writer.write("experiment", e, e.end)
    return str(folder)


def without(*kept):
    """Options that leave only these effects of the library."""
    return [x for n in EFFECTS.names() if n not in kept for x in ("--without", n)]


def call(*arguments):
    return invoke(command, [str(a) for a in arguments])


class Case:
    """A recording and its diagnosis."""

    def __init__(self, folder, *effects, options=None, **recording):
        folder.mkdir(exist_ok=True)
        self.bag = record(folder / "bag", *effects, **recording)
        self.out = folder / "out"
        given = without(*TRIED) if options is None else options
        self.code = call(self.bag, "--out", self.out, *given)
        self.found = json.loads((self.out / "diagnosis.json").read_text())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("diagnosed")


@pytest.fixture(scope="module")
def friction(folder):
    return Case(folder / "friction", "coulomb_friction:torque=0.1")


@pytest.fixture(scope="module")
def forward(folder):
    return Case(folder / "forward", "coulomb_friction:torque=0.1", volts=(4.0, 14.0))


@pytest.fixture(scope="module")
def nothing(folder):
    return Case(folder / "nothing")


@pytest.fixture(scope="module")
def late(folder):
    return Case(folder / "late", "input_delay:delay=0.1")


@pytest.fixture(scope="module")
def cases(friction, forward, nothing, late):
    return {"effect": friction, "ambiguous": forward, "none": nothing, "unknown": late}


# ---- the contract

NUMBER = (int, float)
TOP = {
    "machine": str,
    "recordings": list,
    "experiments": dict,
    "verdict": dict,
    "gap": dict,
    "where": list,
    "candidates": list,
    "remainder": dict,
    "refit": list,
    "undetectable": list,
    "ambiguities": list,
    "next_experiment": (dict, type(None)),
}
ERRORS = {"rmse": NUMBER, "mean_max_error": NUMBER}
MAYBE = (int, float, type(None))
VERDICT = {"kind": str, "effects": list, "confidence": NUMBER, "sentence": str}
GAP = {
    "noise_std": NUMBER,
    "before": dict,
    "after": dict,
    "closed_fraction": MAYBE,
    "closed_fraction_ci95": (list, type(None)),
}
PLACE = {"quantity": str, "from": NUMBER, "to": NUMBER, "unit": str, "share_of_gap": NUMBER}
CANDIDATE = {
    "effect": str,
    "parameters": dict,
    "held_out_rmse": MAYBE,
    "closed_fraction": MAYBE,
    "shapley_share": MAYBE,
    "score": MAYBE,
    "rejected_because": (str, type(None)),
}
AMOUNT = {"value": NUMBER, "unit": str, "ci95": (list, type(None))}
REMAINDER = {"share_of_gap": MAYBE, "structured": bool, "depends_on": list}
NEXT = {"why": str, "voltage": list, "sample_period": NUMBER, "channels": list}
QUANTITIES = {"speed", "voltage", "acceleration", "time", "frequency", "experiment"}
#: Keys beyond the contract.
MORE = {
    "top": {"machine_file", "notes", "effects", "alternatives", "seen"},
    "verdict": {"acting", "grounds"},
    "gap": {"regimes"},
    "where": {"share_of_data", "steady"},
}


def holds(found, keys, more=()):
    """Exactly these keys, each of its type; a truth value is no number."""
    assert set(found) == set(keys) | set(more)
    for name, kind in keys.items():
        assert isinstance(found[name], kind), (name, found[name])
        assert isinstance(found[name], bool) == (kind is bool), name


@pytest.mark.parametrize("kind", ["none", "effect", "ambiguous", "unknown"])
def test_diagnosis_json_has_the_contracts_keys_and_types(cases, kind):
    """Whatever the verdict; what is not defined is null."""
    case = cases[kind]
    found = case.found
    assert case.code == 0
    holds(found, TOP, MORE["top"])
    holds(found["verdict"], VERDICT, MORE["verdict"])
    assert found["verdict"]["kind"] == kind
    assert 0 <= found["verdict"]["confidence"] <= 1
    holds(found["gap"], GAP, MORE["gap"])
    holds(found["gap"]["before"], ERRORS)
    holds(found["gap"]["after"], ERRORS)
    holds(found["remainder"], REMAINDER)
    holds(found["experiments"], {"fit": list, "held_out": list})
    for place in found["where"]:
        holds(place, PLACE, MORE["where"])
        assert place["quantity"] in QUANTITIES
        assert place["from"] <= place["to"]
        assert 0 <= place["share_of_gap"] <= 1
    for candidate in found["candidates"]:
        holds(candidate, CANDIDATE)
        for amount in candidate["parameters"].values():
            holds(amount, AMOUNT)
            assert amount["ci95"] is None or len(amount["ci95"]) == 2
    if found["next_experiment"] is not None:
        holds(found["next_experiment"], NEXT)
        assert set(found["next_experiment"]["channels"]) >= {"voltage", "speed"}
    assert {c["effect"] for c in found["candidates"]} == set(TRIED)
    assert found["recordings"] == [case.bag]
    assert found["machine"] == "rotor"


def test_the_verdicts_are_what_was_simulated(cases):
    """One effect, a group that holds it, none of them."""
    effects = {kind: case.found["verdict"]["effects"] for kind, case in cases.items()}
    assert effects["none"] == effects["unknown"] == []
    assert effects["effect"] == ["coulomb_friction"]
    assert set(effects["ambiguous"]) == {"coulomb_friction", "constant_load"}
    assert ["coulomb_friction", "constant_load"] in [
        sorted(g, reverse=True) for g in cases["ambiguous"].found["ambiguities"]
    ]


def test_there_is_nothing_to_close_without_a_gap(nothing):
    """Null, not 0 or 1."""
    gap = nothing.found["gap"]
    assert gap["closed_fraction"] is None
    assert gap["closed_fraction_ci95"] is None
    assert nothing.found["where"] == []
    assert nothing.found["remainder"]["share_of_gap"] is None


@pytest.mark.parametrize("kind", ["none", "effect", "ambiguous", "unknown"])
def test_the_page_says_the_sentence(cases, kind):
    """A page in one file, with the verdict in it."""
    page = (cases[kind].out / "diagnosis.html").read_text(encoding="utf-8")
    assert page.lstrip().lower().startswith("<!doctype html")
    assert page.count("<path") >= 10
    assert 'src="http' not in page
    assert len(page) > 5000


def test_json_prints_the_file_alone_and_the_same_again(friction, tmp_path, capfd):
    """The same call, the same bytes."""
    code = call(friction.bag, "--out", tmp_path, "--json", *without(*TRIED))
    out, err = capfd.readouterr()
    assert code == 0
    assert err == ""
    assert json.loads(out) == friction.found
    assert (tmp_path / "diagnosis.json").read_text() == out
    assert (friction.out / "diagnosis.json").read_text() == out


def test_the_terminal_shows_the_sentence_the_files_and_the_next_command(friction, tmp_path, capfd):
    code = call(friction.bag, "--out", tmp_path / "new" / "folder", *without(*TRIED[:2]))
    out, _ = capfd.readouterr()
    assert code == 0
    assert out.splitlines()[0].startswith("Coulomb friction (torque = 0.1")
    assert "diagnosis.html" in out.splitlines()[-2]
    kept = tmp_path / "new" / "folder" / "diagnosis.json"
    assert f"--with {kept} --out FILE.yaml" in out.splitlines()[-1]
    assert (tmp_path / "new" / "folder" / "diagnosis.json").exists()


def test_several_recordings_are_numbered_on(friction, nothing, tmp_path):
    """Eight experiments of two recordings."""
    call(friction.bag, nothing.bag, "--out", tmp_path, *without(*TRIED))
    found = json.loads((tmp_path / "diagnosis.json").read_text())
    numbers = found["experiments"]["fit"] + found["experiments"]["held_out"]
    assert sorted(numbers) == list(range(1, 9))


# ---- many recordings, each by itself


@pytest.fixture(scope="module")
def each(folder, friction, nothing):
    """Two recordings of one name and one that is not there, diagnosed each by itself."""
    out = folder / "each"
    bags = [friction.bag, nothing.bag, str(folder / "nowhere")]
    code = call(*bags, "--each", "--jobs", "2", "--out", out, *without(*TRIED))
    return code, bags, out


def test_each_recording_gets_the_answer_that_it_gets_alone(each, friction, nothing):
    """In a folder named after it, to the last bit, whatever becomes of the others."""
    code, _, out = each
    assert code == BAD
    for case, name in ((friction, "friction"), (nothing, "nothing")):
        found = json.loads((out / name / "bag" / "diagnosis.json").read_text())
        assert found == case.found
        assert (out / name / "bag" / "diagnosis.html").stat().st_size > 5000
    assert not (out / "nowhere").exists()


def test_each_goes_on_where_it_was_and_says_what_failed(each, capfd, monkeypatch):
    """Nothing is diagnosed again; the one that fails is one sentence on standard error."""
    _, bags, out = each
    monkeypatch.setattr("ldt_core.diagnosis.diagnose.diagnose", None)
    capfd.readouterr()
    code = call(*bags, "--each", "--jobs", "1", "--json", "--out", out, *without(*TRIED))
    text, err = capfd.readouterr()
    assert code == BAD
    assert err.count("\n") == 1
    assert "nowhere" in err
    kinds = [a["diagnosis"] and a["diagnosis"]["verdict"]["kind"] for a in json.loads(text)]
    assert kinds == ["effect", "none", None]
    assert [a["recording"] for a in json.loads(text)] == bags


def test_no_confidence_is_called_100_per_cent():
    """A diagnosis of the same recording alone says "above 99%"."""
    verdict = {"kind": "effect", "acting": [["inertia"]], "confidence": 0.997}
    gap = {"closed_fraction": 0.9, "before": {"rmse": 1.0}, "after": {"rmse": 0.1}}
    row = _row(RecordingAnswer("bag", Path("out"), {"verdict": verdict, "gap": gap}))
    assert row[3] == "above 99%"


def test_each_ends_with_a_table_of_verdicts(each, capfd):
    """A row for every recording, those that failed included; and exit code 0 without any."""
    _, bags, out = each
    options = without(*TRIED)
    capfd.readouterr()
    assert call(*bags[:2], "--each", "--jobs", "1", "--out", out, *options) == 0
    text, err = capfd.readouterr()
    assert err == ""
    for word in ("coulomb_friction", "none", "effect"):
        assert word in text


def test_each_diagnoses_again_what_would_come_out_differently(each, capfd, monkeypatch):
    """Another seed is another answer: what is on disk is not taken for it."""
    _, bags, out = each
    monkeypatch.setattr("ldt_core.diagnosis.diagnose.diagnose", None)
    about = ["--each", "--jobs", "1", "--seed", "1", *without(*TRIED)]
    assert call(bags[0], "--out", out / "friction", *about) == 1
    assert "TypeError" in capfd.readouterr().err


# ---- the promise


def held_out_rmse(case, tmp_path, *options):
    """Of the predictions that `ldt predict` writes."""
    out = tmp_path / "predicted"
    assert invoke(predict.command, [case.bag, "--out", str(out), *map(str, options)]) == 0
    measured = {e.number: e for e in read_bag(case.bag).experiments()}
    predicted = {p.number: p for p in read_bag(str(out)).records("prediction")}
    rest = [measured[n].speed - predicted[n].speed for n in case.found["experiments"]["held_out"]]
    return float(np.sqrt(np.mean(np.concatenate(rest) ** 2)))


@pytest.mark.parametrize("kind", ["none", "effect", "ambiguous", "unknown"])
def test_predict_adds_exactly_what_the_diagnosis_promised(cases, kind, tmp_path):
    """The same root mean square error on the held-out experiments, before and after."""
    case = cases[kind]
    gap = case.found["gap"]
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    before = held_out_rmse(case, tmp_path / "a")
    after = held_out_rmse(case, tmp_path / "b", "--with", case.out / "diagnosis.json")
    assert before == pytest.approx(gap["before"]["rmse"], rel=1e-9)
    assert after == pytest.approx(gap["after"]["rmse"], rel=1e-9)


def test_a_diagnosis_of_another_program_is_read_by_the_contract_alone(friction, tmp_path):
    """Without the keys that only LDT writes."""
    bare = {k: v for k, v in friction.found.items() if k not in MORE["top"]}
    bare["verdict"] = {k: v for k, v in bare["verdict"].items() if k != "acting"}
    file = tmp_path / "bare.json"
    file.write_text(json.dumps(bare))
    after = held_out_rmse(friction, tmp_path, "--with", file)
    assert after == pytest.approx(friction.found["gap"]["after"]["rmse"], rel=1e-9)


def test_predict_says_what_it_promises_there(forward, tmp_path, capsys):
    """More of the same closes; backward, a load and a friction differ."""
    given = ["--with", str(forward.out / "diagnosis.json"), "--json"]
    back = record(tmp_path / "back", "coulomb_friction:torque=0.1")
    for bag, made in ((forward.bag, True), (back, False)):
        capsys.readouterr()
        out = str(tmp_path / f"predicted_{made}")
        assert invoke(predict.command, [bag, "--machine", "rotor", *given, "--out", out]) == 0
        promise = json.loads(capsys.readouterr().out)["promise"]
        assert (promise["closed_fraction"] is not None) is made
        assert bool(promise["refused"]) is not made


# ---- effects of one's own


@pytest.fixture(scope="module")
def own(folder):
    """The README's effect, in a file, and a machine that has it."""
    file = folder / "cubic_drag.py"
    file.write_text(CUBIC_DRAG)
    name = f"{file}:CUBIC_DRAG"
    options = [*without(*TRIED), "--effect", name]
    return name, Case(folder / "own", f"{name}:c=5e-6", options=options)


def test_an_effect_of_ones_own_is_diagnosed(own):
    """Named, with its amount, ahead of the library's drag that grows with the square."""
    _, case = own
    assert case.found["verdict"]["kind"] == "effect"
    assert case.found["verdict"]["effects"] == ["cubic_drag"]
    low, high = case.found["candidates"][0]["parameters"]["c"]["ci95"]
    assert low <= 5e-6 <= high
    assert high - low < 1.25e-6


def test_predict_takes_an_effect_of_ones_own_only_when_it_is_given(own, tmp_path, capfd):
    """A file's text is never run for being named in a diagnosis."""
    name, case = own
    diagnosis = case.out / "diagnosis.json"
    code = invoke(
        predict.command, [case.bag, "--out", str(tmp_path / "no"), "--with", str(diagnosis)]
    )
    sentence(code, capfd, "`own_effects: [file.py:NAME]` (ldt docs effect), got 'cubic_drag'")
    after = held_out_rmse(case, tmp_path, "--with", diagnosis, "--effect", name)
    assert after == pytest.approx(case.found["gap"]["after"]["rmse"], rel=1e-9)


def test_a_prediction_that_a_diagnosis_makes_worse_is_told_so(friction, nothing, tmp_path, capsys):
    """Of a machine that never had the effect."""
    given = ["--machine", "rotor", "--with", str(friction.out / "diagnosis.json")]
    for case, worse in ((nothing, True), (friction, False)):
        out = str(tmp_path / f"{worse}")
        assert invoke(predict.command, [str(case.bag), *given, "--out", out]) == 0
        assert ("make this prediction worse" in capsys.readouterr().err) is worse


# ---- what is refused


@pytest.mark.parametrize(
    "command", [["predict", "{bag}"], ["simulate"], ["calibrate", "{bag}"], ["advise"]]
)
def test_a_diagnosis_of_another_machine_is_refused(command, friction, tmp_path, capsys):
    """It was taken without a word, and showed in large errors only."""
    file, out = tmp_path / "diagnosis.json", tmp_path / "made"
    file.write_text(json.dumps({"machine": "press", "verdict": {"kind": "none"}}))
    words = [word.format(bag=friction.bag) for word in command]
    option = "--next" if words[0] == "simulate" else "--with"
    target = ["--effect", "unbalance:e=1e-3"] if words[0] == "advise" else ["--out", str(out)]
    assert invoke(ldt, [*words, option, str(file), *target]) == BAD
    told = capsys.readouterr().err
    assert "expected a diagnosis of the machine 'rotor', got one of 'press'" in told
    assert not out.exists()


def sentence(code, capfd, *words):
    """Exit 2, and one sentence on standard error that holds these words."""
    out, err = capfd.readouterr()
    assert code == BAD, err
    assert out == ""
    assert err.startswith("ldt: ")
    assert err.count("\n") == 1
    for word in words:
        assert word in err
    assert "Traceback" not in err


REFUSED = {
    "no such recording": (["{folder}/nowhere"], "nowhere"),
    "share of 2": (["{bag}", "--holdout", "2"], "holdout"),
    "share of 0": (["{bag}", "--holdout", "0"], "holdout"),
    "share that is no number": (["{bag}", "--holdout", "nan"], "holdout"),
    "unknown effect left out": (["{bag}", "--without", "inertai"], "inertia"),
    "a parameter that the machine lacks": (["{bag}", "--refit", "mass"], "--refit"),
    "the motor's e": (["{motor}", "--refit", "e"], "--refit"),
    "another machine's file": (["{bag}", "--machine", "dc_motor"], "leave --machine out"),
    "no effect file": (["{bag}", "--effect", "{folder}/none.py:X"], "none.py"),
    "nothing of that name in it": (["{bag}", "--effect", "{folder}/cubic_drag.py:X"], "X"),
    "an effect that the machine cannot have": (
        ["{motor}", "--effect", "unbalance"],
        "unbalance",
    ),
    "--out is a file": (["{bag}", "--out", "{folder}/cubic_drag.py"], "--out"),
    "too short": (["{folder}/short"], "samples"),
    "outside the limits": (["{folder}/strong"], "voltage"),
    "no recording": ([], "RECORDINGS"),
    "one recording twice": (["{bag}", "{bag}", "--each"], "twice"),
    "processes without --each": (["{bag}", "--jobs", "2"], "--each"),
    "a cluster without --each": (["{bag}", "--scheduler", "tcp://a:1"], "--each"),
    "no such cluster": (["{bag}", "--each", "--scheduler", "nonsense"], "nonsense"),
    "no such machine": (["{bag}", "--machine", "rotr"], "rotor"),
}


@pytest.fixture(scope="module")
def bad(folder, friction, own):
    record(folder / "short", count=1, samples=150)
    record(folder / "strong", volts=(30.0, 40.0), samples=100)
    motor = folder / "motor"
    given = ["--machine", "dc_motor", "--experiments", "1", "--out", str(motor)]
    assert invoke(simulate, given) == 0
    return {"folder": folder, "bag": friction.bag, "motor": str(motor)}


@pytest.mark.parametrize("name", sorted(REFUSED))
def test_bad_input_is_refused_in_a_sentence(bad, name, tmp_path, capfd):
    """Exit code 2, and nothing is written."""
    arguments, word = REFUSED[name]
    given = [a.format(**bad) for a in arguments]
    out = tmp_path / "out"
    if "--out" not in given:
        given += ["--out", str(out)]
    capfd.readouterr()
    sentence(call(*given), capfd, word)
    assert not (out / "diagnosis.json").exists()


BROKEN = {
    "no JSON": "{",
    "deep": "[" * 100_000,
    "a list": "[]",
    "no verdict": "{}",
    "a verdict that is text": '{"verdict": "coulomb_friction"}',
    "effects without parameters": '{"verdict": {}, "effects": [{"effect": "inertia"}]}',
    "a parameter that is text": json.dumps(
        {"verdict": {}, "effects": [{"effect": "inertia", "parameters": {"factor": "much"}}]}
    ),
    "a parameter that does not exist": json.dumps(
        {"verdict": {}, "effects": [{"effect": "inertia", "parameters": {"facto": 1.0}}]}
    ),
    "out of bounds": json.dumps(
        {"verdict": {}, "effects": [{"effect": "inertia", "parameters": {"factor": -1.0}}]}
    ),
    "not a number": '{"verdict": {}, "effects": [{"effect": "inertia", "parameters": '
    '{"factor": NaN}}]}',
    "an effect in a file": json.dumps(
        {"verdict": {}, "effects": [{"effect": "evil.py:EFFECT", "parameters": {}}]}
    ),
    "effects that are a number": '{"verdict": {}, "effects": 5}',
    "a number beyond floating point": '{"verdict": {}, "effects": [{"effect": "inertia", '
    f'"parameters": {{"factor": 1{"0" * 400}}}}}]}}',
    "yes for a number": '{"verdict": {}, "effects": [{"effect": "inertia", "parameters": '
    '{"factor": true}}]}',
    "an effect without its amount": '{"verdict": {}, "effects": [{"effect": "inertia", '
    '"parameters": {}}]}',
    "an effect twice": json.dumps(
        {"verdict": {}, "effects": 2 * [{"effect": "inertia", "parameters": {"factor": 1.5}}]}
    ),
    "a verdict of no known kind": json.dumps({"verdict": {"kind": "sure"}, "effects": []}),
    "a kind that is a list": json.dumps({"verdict": {"kind": ["effect"]}, "effects": []}),
    "a verdict without effects": '{"verdict": {"kind": "effect"}}',
}


@pytest.mark.parametrize("name", sorted(BROKEN))
def test_predict_refuses_what_is_no_diagnosis(friction, name, tmp_path, capfd):
    """Exit code 2, one sentence, nothing written, nothing run."""
    file, out = tmp_path / "diagnosis.json", tmp_path / "predicted"
    file.write_text(BROKEN[name])
    capfd.readouterr()
    code = invoke(predict.command, [friction.bag, "--with", str(file), "--out", str(out)])
    sentence(code, capfd)
    assert not out.exists()


def test_predict_refuses_a_diagnosis_that_is_not_there(friction, tmp_path, capfd):
    capfd.readouterr()
    arguments = [friction.bag, "--with", str(tmp_path / "none.json"), "--out", str(tmp_path / "p")]
    sentence(invoke(predict.command, arguments), capfd, "none.json")


def test_the_next_experiment_is_run_as_it_was_designed(tmp_path):
    """Voltage, sample period and channels are those of the file."""
    volts = [0.0, 3.0, -3.0, 1.0] * 30
    asked = {"why": "", "voltage": volts, "sample_period": 0.02, "channels": ["voltage", "current"]}
    file = tmp_path / "diagnosis.json"
    file.write_text(json.dumps({"verdict": {"kind": "ambiguous"}, "next_experiment": asked}))
    about = ["--experiments", "2", "--next", str(file), "--out", str(tmp_path / "made")]
    assert invoke(simulate, about) == 0
    (one, other) = read_bag(str(tmp_path / "made"), "").experiments()
    assert one.voltage.tolist() == other.voltage.tolist() == volts
    assert one.period == 0.02
    assert one.current is not None


@pytest.mark.parametrize(
    "asked",
    [
        None,
        {"voltage": "all"},
        {"voltage": [99.0], "channels": []},
        {"voltage": [9.0], "channels": ["speed", "torque"]},
    ],
)
def test_a_next_experiment_that_is_none_is_refused(tmp_path, capsys, asked):
    """Nothing open, nonsense, and a voltage that the machine cannot have."""
    file = tmp_path / "diagnosis.json"
    if asked is not None:
        asked.setdefault("sample_period", 0.01)
    file.write_text(json.dumps({"verdict": {}, "next_experiment": asked}))
    assert invoke(simulate, ["--next", str(file), "--out", str(tmp_path / "made")]) == BAD
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
