"""`ldt challenge make`: repeatable, sealed, and with a key whose hash is known first."""

from __future__ import annotations

import hashlib
import itertools
import json
import re
from collections import Counter

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from made_case import make_case

from ldt_core.base.errors import OptionError
from ldt_core.base.experiment import rms
from ldt_core.cli.challenge import command
from ldt_core.lab.challenge.case_plan import FURTHER, KINDS, MEMBERS, plan_case
from ldt_core.lab.challenge.laws import LAWS, OUTSIDE
from ldt_core.lab.challenge.make import SHARES, case_orders, make_challenge
from ldt_core.lab.challenge.rig import ALIKE, OTHER, SHOWN, CaseBench
from ldt_core.lab.challenge.simulation import Unsteady
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.bag import experiments, read_bag

pytestmark = pytest.mark.slow

#: A seed that draws a case of each kind, and no machine so stiff that it takes seconds.
CASES, SAMPLES, SEED = 6, 200, 3


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """(folder of cases, key file, what was said before they were written)."""
    out = tmp_path_factory.mktemp("challenge") / "cases"
    said = []
    key = make_challenge(
        *(CASES, SEED, out),
        samples=SAMPLES,
        jobs=1,
        say=lambda digest: said.append((digest, out.exists())),
    )
    return out, key, said


def test_the_hash_of_the_key_is_told_before_any_case_is_there(made):
    """And it is that of the file's bytes."""
    _, key, said = made
    assert said == [(hashlib.sha256(key.read_bytes()).hexdigest(), False)]


def test_the_same_command_gives_the_same_key_and_the_same_recordings(made, tmp_path):
    """Also in two processes; another seed gives another one."""
    out, key, _ = made
    again = make_challenge(CASES, SEED, tmp_path / "cases", samples=SAMPLES, jobs=2)
    assert again.read_bytes() == key.read_bytes()
    for file in sorted(out.rglob("*.mcap")):
        twin = tmp_path / "cases" / file.relative_to(out)
        for a, b in zip(experiments(file).experiments, experiments(twin).experiments, strict=True):
            assert np.array_equal(a.voltage, b.voltage)
            assert np.array_equal(a.speed, b.speed)
    assert case_orders(CASES, SEED + 1) != case_orders(CASES, SEED)


def test_a_cases_folder_holds_two_recordings_and_a_machine_file(made):
    """All of the same names; the further experiments go on where the shown ones end."""
    out, _, _ = made
    for folder in out.iterdir():
        assert sorted(p.name for p in folder.iterdir()) == ["further", "machine.yaml", "recording"]
        machine = load_machine(folder / "machine.yaml")
        shown, further = (experiments(folder / n).experiments for n in ("recording", "further"))
        # At half the rate, or pieces of one record.
        assert {len(e) for e in shown} <= {SAMPLES, SAMPLES // 2, SAMPLES // 4}
        assert len(shown) == SHOWN
        assert [e.number for e in [*shown, *further]] == list(range(1, SHOWN + ALIKE + OTHER + 1))
        assert list(read_bag(folder / "recording").topics) == ["/experiment"]
        for experiment in (*shown, *further):
            machine.check(experiment)
        assert len({e.current is None for e in (*shown, *further)}) == 1


def test_nothing_in_the_folders_tells_what_acts(made):
    """No kind, effect or cause by its name, no seed; metadata differ in sums and sizes alone."""
    out, key, _ = made
    words = [*LAWS, *OUTSIDE, *(k for k in KINDS if k != "none"), "seed", "effect", "truth"]
    metadata = set()
    for file in (f for f in out.rglob("*") if f.is_file()):
        data = file.read_bytes()
        assert [w for w in words if w.encode() in data.lower()] == [], file
        if file.name == "metadata.yaml" and file.parent.name == "recording":
            same = re.sub(rb"(nanoseconds|nanoseconds_since_epoch): \d+", b"", data)
            metadata.add(same.replace(b"motor", b"rotor"))
    assert len(metadata) == 1
    assert key.parent == out.parent


def test_the_key_says_what_acts_and_how_much_of_it(made):
    """One entry a case, in order, with all that a score needs."""
    out, key, _ = made
    entries = json.loads(key.read_text())
    assert {e["kind"] for e in entries} >= {"none", "single", "pair", "outside"}
    assert [e["case"] for e in entries] == sorted(p.name for p in out.iterdir())
    for e in entries:
        assert e["kind"] in KINDS
        acting = [e["outside"]] if e["kind"] == "outside" else e["effects"]
        assert len(acting) == MEMBERS[e["kind"]]
        assert sorted(e["parameters"]) == e["effects"]
        assert e["signal_to_noise"] == pytest.approx(e["gap_rms"] / e["noise"], rel=1e-4)
        assert (e["gap_rms"] == 0) == (e["kind"] == "none")
        for name in e["effects"]:
            units = {p: v["unit"] for p, v in e["parameters"][name].items()}
            assert units == dict(LAWS[name].units)
        assert e["left_out"] is None


@given(cases=st.integers(1, 400), seed=st.integers(0, 2**32 - 1))
def test_the_mix_has_its_shares_and_every_effect_in_turn(cases, seed):
    """Counts within one of the shares, effects within one of each other, whatever the number."""
    made = case_orders(cases, seed)
    kinds = Counter(o.kind for o in made)
    assert len(made) == cases == len({o.seed for o in made})
    for kind, share in SHARES.items():
        assert abs(kinds[kind] - cases * share / 100) < 1
    singles = Counter(o.effects[0] for o in made if o.kind == "single")
    assert max(singles.values(), default=0) - min((singles[n] for n in LAWS), default=0) <= 1


def test_the_order_of_the_cases_is_shuffled():
    """Kinds come in no runs: neighbours are no more alike than chance has it."""
    kinds = [o.kind for o in case_orders(400, 1)]
    alike = np.mean([a == b for a, b in itertools.pairwise(kinds)])
    chance = sum((share / 100) ** 2 for share in SHARES.values())
    assert alike == pytest.approx(chance, abs=0.1)


def test_leaving_one_out_takes_each_effect_in_turn():
    """Single effects only, each the one that the diagnosis has to do without."""
    made = case_orders(2 * len(LAWS), 1, leave_one_out=True)
    assert Counter(o.left_out for o in made) == dict.fromkeys(LAWS, 2)
    assert all(o.kind == "single" and o.effects == (o.left_out,) for o in made)


def test_a_case_in_memory_is_the_same_for_the_same_seed():
    """Its experiments as its truth."""
    first, again = (make_case("single", ["inertia"], seed=5, samples=200) for _ in range(2))
    assert first.truth == again.truth
    for a, b in zip(first.experiments, again.experiments, strict=True):
        assert np.array_equal(a.speed, b.speed)
    other = make_case("single", ["inertia"], seed=6, samples=200)
    assert other.truth != first.truth


@pytest.mark.parametrize(
    ("kind", "effects", "sentence"),
    [
        ("duo", (), "kind of case: expected one of .* got 'duo'"),
        ("single", ("coulomb",), "did you mean 'coulomb_friction'"),
        ("single", ("belt_wow",), "effect: expected one of"),
        ("none", ("inertia",), "effects of a none case: expected 0 at most, got 1"),
        ("pair", ("inertia", "torsional_compliance"), "of different families"),
    ],
)
def test_what_cannot_be_made_is_refused(kind, effects, sentence):
    """In one sentence."""
    with pytest.raises(OptionError, match=sentence):
        plan_case(kind, effects, seed=(0,))


def test_a_motor_without_foundation_cannot_be_out_of_balance():
    """Asked for, it is refused; left open, a rotor is drawn."""
    with pytest.raises(OptionError, match="physics: expected dc_motor_rotor for unbalance"):
        plan_case("single", ["unbalance"], seed=(0,), physics="dc_motor")


def test_what_is_there_is_not_overwritten_and_the_key_is_kept_apart(made, tmp_path):
    """Neither cases nor a key; a key among the cases would be no seal."""
    out, key, _ = made
    with pytest.raises(OptionError, match="out: expected a place where nothing is yet"):
        make_challenge(1, 0, out)
    with pytest.raises(OptionError, match="key: expected a place where nothing is yet"):
        make_challenge(1, 0, tmp_path / "new", key)
    with pytest.raises(OptionError, match="with the cases"):
        make_challenge(1, 0, tmp_path / "new", tmp_path / "new" / "key.json")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_challenge_that_is_broken_off_leaves_nothing(jobs, tmp_path):
    """Neither some of the cases nor the key: the same command can be given again."""
    out = tmp_path / "new" / "cases"

    def broken_off(items, total, doing):
        for index, item in enumerate(items):
            if doing == "writing" and index == 1:
                raise KeyboardInterrupt
            yield item

    with pytest.raises(KeyboardInterrupt):
        make_challenge(2, SEED, out, samples=SAMPLES, jobs=jobs, progress=broken_off)
    assert list(out.parent.iterdir()) == []
    key = make_challenge(1, SEED, out, samples=SAMPLES, jobs=1)
    assert sorted(out.parent.iterdir()) == [out, key]
    assert out.stat().st_mode == out.parent.stat().st_mode


def test_what_comes_to_the_place_meanwhile_is_not_overwritten(tmp_path):
    """A folder of somebody else's."""
    out = tmp_path / "cases"
    with pytest.raises(OptionError, match="out: expected a place where nothing is yet"):
        make_challenge(1, SEED, out, samples=SAMPLES, jobs=1, say=lambda digest: out.mkdir())
    assert list(tmp_path.iterdir()) == [out]
    assert list(out.iterdir()) == []


def test_the_command_prints_the_hash_first(tmp_path):
    """Then where the cases and the key are."""
    out, key = tmp_path / "cases", tmp_path / "answers.json"
    options = ["make", "--cases", "1", "--seed", "7", "--out", out, "--key", key, "--jobs", "1"]
    done = CliRunner().invoke(command, [str(o) for o in options], catch_exceptions=False)
    digest = hashlib.sha256(key.read_bytes()).hexdigest()
    assert done.stdout.splitlines() == [
        f"SHA-256 of the key: {digest}",
        f"1 cases: {out}; key: {key}",
    ]


def test_the_key_knows_the_noise_as_it_fell_out_on_further_experiments():
    """What was recorded by a sensor without steps is the motion plus just that."""
    plan = plan_case("single", ["constant_load"], seed=(7,), samples=400)
    assert plan.setting.quantum == 0
    bench = CaseBench(plan.setting)
    quiet = bench.speeds(plan.acting, FURTHER)
    for number, speed, e in zip(FURTHER, quiet, plan.further(), strict=True):
        assert plan.truth["further_noise"][str(number)] == pytest.approx(rms(e.speed - speed), 1e-5)


def test_a_case_with_an_experiment_that_diverges_is_drawn_anew(monkeypatch):
    """A speed controller drove a machine where its trials did not, when its case was written."""
    plain, diverged = CaseBench.experiment, []

    def diverging(bench, acting, number):
        if number == FURTHER[-1] and not diverged:
            diverged.append(bench.setting)
            raise Unsteady("it has no bound")
        return plain(bench, acting, number)

    monkeypatch.setattr(CaseBench, "experiment", diverging)
    plan = plan_case("single", ["inertia"], seed=(5,), samples=200)
    assert len([*plan.experiments(), *plan.further()]) == SHOWN + len(FURTHER)
    assert plan.setting is not diverged[0]
