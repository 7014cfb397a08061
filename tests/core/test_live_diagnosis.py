"""Claims about the diagnosis of a running machine: when, of which experiments, and what it says."""

from __future__ import annotations

import json
import threading
from dataclasses import replace

import numpy as np
import pytest
from fake_archive import FakeArchive

from ldt_core.base.errors import LdtError, OptionError
from ldt_core.base.experiment import Action, Adaptation, Level, Prediction, Signal
from ldt_core.base.settings import resolve
from ldt_core.diagnosis.diagnosis import (
    Diagnosis,
    Gap,
    HeldOutErrors,
    RankedCandidate,
    Remainder,
    Verdict,
)
from ldt_core.effects import get_effect, parse_effect
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.models import build_model
from ldt_core.twin.diagnoser import Diagnoser
from ldt_core.twin.loop import Twin, build_adaptor
from ldt_core.twin.stage import RecordedStep

pytestmark = pytest.mark.slow

SHORT = replace(load_machine("rotor"), duration=4.0)
LEVELS = {"-": Level.NEGATIVE, "0": Level.WARNING, "+": Level.POSITIVE}


def worn(e, number):
    """An experiment of a machine with this eccentricity [m]."""
    effects = [parse_effect(f"unbalance:e={e}")] if e else []
    plant = Plant(SHORT, degradation="none", effects=effects, seed=3, start_time=1e9)
    return plant.experiment(number)


def verdict(kind, *found, shares=()):
    """A diagnosis that says so; `found` are (effect, parameters)."""
    names = [name for name, _ in found]
    errors = HeldOutErrors(1.0, 2.0)
    closed = None if kind == "none" else 0.9
    shares = shares or [1.0] * len(names)
    return Diagnosis(
        machine="rotor",
        recordings=[],
        experiments={"fit": [1], "held_out": [2]},
        verdict=Verdict(kind, names, [[n] for n in names], 0.9, f"It is {kind}."),
        gap=Gap(0.1, errors, errors, closed, None),
        where=[],
        candidates=[
            RankedCandidate(n, {}, 1.0, 0.5, s, 0.5, None)
            for n, s in zip(names, shares, strict=True)
        ],
        remainder=Remainder(0.1, False, []),
        undetectable=[],
        ambiguities=[],
        next_experiment=None,
        effects=[{"effect": name, "parameters": given} for name, given in found],
    )


class Scripted:
    """In place of `diagnose`: knows the true eccentricity of each experiment.

    One machine's experiments are its unbalance; mixed ones are unknown, as a real diagnosis finds.
    """

    def __init__(self, truth):
        self.truth = truth
        self.asked = []

    def __call__(self, machine, experiments, *, workers, tick):
        self.asked.append([e.number for e in experiments])
        tick("thinking")
        values = {self.truth[e.number - 1] for e in experiments}
        if len(values) > 1:
            return verdict("unknown")
        (e,) = values
        return verdict("effect", ("unbalance", {"e": e})) if e else verdict("none")


def fed(truth, signs, make=None, **settings):
    """(diagnoser, what it answered, what it was asked) after these experiments and signals."""
    make = make or Scripted(truth)
    diagnoser = Diagnoser(SHORT, settings, make)
    answers = [
        diagnoser.step(worn(e, i), Signal(i, LEVELS[sign], "threshold", 7, 1.0))
        for i, (e, sign) in enumerate(zip(truth, signs, strict=True), 1)
    ]
    return diagnoser, answers, getattr(make, "asked", None)


def test_it_diagnoses_at_positives_alone():
    """Neither a warning nor a negative is an occasion."""
    _, answers, asked = fed([0.008] * 4, "-0-+")
    assert [a is not None for a in answers] == [False, False, False, True]
    assert (answers[3].experiment, answers[3].model_version, answers[3].kind) == (4, 7, "effect")
    assert asked[0] == [4]


def test_a_verdict_that_still_holds_is_not_sought_again_at_once():
    """But after `diagnosis_every` experiments it is, of all that it explains."""
    _, answers, asked = fed([0.008] * 5, "+++++", diagnosis_every=3)
    assert [a is not None for a in answers] == [True, False, False, True, False]
    assert asked == [[1], [1, 2, 3, 4]]


def test_a_verdict_that_no_longer_holds_is_sought_again_at_once():
    """However short the time since the last one."""
    _, answers, _ = fed([0.008, 0.008, 0.012], "+-+", diagnosis_every=100)
    assert [a is not None for a in answers] == [True, False, True]
    assert [a.values["amount.unbalance.e"] for a in answers if a] == [0.008, 0.012]


def test_experiments_before_a_negative_are_not_taken_for_the_same_machine():
    """The model explained them, and does not explain the present one."""
    _, answers, asked = fed([0.0, 0.0, 0.008, 0.008], "--0+")
    assert asked == [[4], [3, 4]]
    assert answers[-1].values["since"] == 3


def test_what_the_last_verdict_explains_is_of_the_machine_as_it_was():
    """Where no model learns, all signals are positive, and the last verdict tells the change."""
    _, answers, asked = fed([0.008] * 3 + [0.012] * 2, "+++++", diagnosis_every=100)
    assert asked == [[1], [4]]
    assert answers[3].values["since"] == 4


def test_experiments_that_the_verdict_explains_join_it():
    """A false alarm, or a late one: those before it are as good, whatever their signals were."""
    _, answers, asked = fed([0.008] * 3, "--+")
    assert asked == [[3], [1, 2, 3]]
    assert answers[-1].values["since"] == 1


def test_a_machine_that_changes_is_not_diagnosed_of_a_mixture():
    """Alone the last experiment tells its cause, which does not explain those before."""
    _, answers, asked = fed([0.008, 0.008, 0.012], "00+")
    assert asked == [[3]]
    assert (answers[-1].kind, answers[-1].values["amount.unbalance.e"]) == ("effect", 0.012)


def test_more_experiments_that_make_it_worse_are_left_out():
    """What a diagnosis with the others says must explain the present one as well."""

    class Contrary(Scripted):
        def __call__(self, machine, experiments, **how):
            found = super().__call__(machine, experiments, **how)
            return found if len(experiments) == 1 else verdict("unknown")

    _, answers, asked = fed([0.008] * 3, "--+", Contrary([0.008] * 3))
    assert asked == [[3], [1, 2, 3]]
    assert (answers[-1].kind, answers[-1].values["since"]) == ("effect", 3)


@pytest.mark.parametrize(
    ("alone", "together", "said"),
    [
        ("ambiguous", "effect", ("effect", 1)),
        ("ambiguous", "unknown", ("ambiguous", 3)),
        ("unknown", "effect", ("effect", 1)),
        ("none", "effect", ("effect", 1)),
        ("unknown", "unknown", ("unknown", 3)),
    ],
)
def test_what_one_experiment_does_not_tell_is_asked_of_several(alone, together, said):
    """At one speed all losses are alike. Several experiments count where they say more."""

    def make(machine, experiments, **how):
        kind = together if len(experiments) > 1 else alone
        return verdict(kind, *([("unbalance", {"e": 0.008})] if kind in named else []))

    named = ("effect", "ambiguous")
    _, answers, _ = fed([0.008] * 3, "00+", make)
    assert (answers[-1].kind, answers[-1].values["since"]) == said


def test_several_that_explain_the_present_one_worse_do_not_count():
    """They are of different machines, and what they say together is a mean."""

    def make(machine, experiments, **how):
        kind, e = ("effect", 0.010) if len(experiments) > 1 else ("ambiguous", 0.012)
        return verdict(kind, ("unbalance", {"e": e}))

    _, answers, _ = fed([0.008, 0.008, 0.012], "00+", make)
    assert (answers[-1].kind, answers[-1].values["amount.unbalance.e"]) == ("ambiguous", 0.012)


def test_what_is_unknown_alone_as_well_stays_unknown():
    """No name only because something must be said, and no cause for a model."""
    _, answers, _ = fed([0.008] * 2, "0+", lambda *_, **how: verdict("unknown"))
    assert (answers[-1].kind, answers[-1].effects, answers[-1].cause) == ("unknown", (), None)


def test_no_more_experiments_are_kept_than_asked_for():
    """The last ones."""
    _, _, asked = fed([0.008] * 6, "0" * 5 + "+", diagnosis_experiments=3)
    assert asked == [[6], [4, 5, 6]]


def test_experiments_of_another_sample_period_are_not_mixed_in():
    """The noise and the machine's memory count in samples."""
    make = Scripted([0.008] * 3)
    diagnoser = Diagnoser(SHORT, {}, make)
    slow = replace(worn(0.008, 1), period=0.04)
    for e, sign in ((slow, "0"), (worn(0.008, 2), "0"), (worn(0.008, 3), "+")):
        diagnoser.step(e, Signal(e.number, LEVELS[sign], "threshold", 0, 1.0))
    assert make.asked == [[3], [2, 3]]


def test_the_record_has_the_scalars_of_the_diagnosis():
    """By dotted name, undefined ones null; and nothing that is a list or an object."""
    _, (answer,), _ = fed([0.008], "+")
    assert answer.sentence.startswith("It is effect. Confidence: ")
    assert answer.effects == ("unbalance",)
    assert answer.values["gap.closed_fraction"] == 0.9
    assert answer.values["gap.before.rmse"] == 1.0
    assert answer.values["remainder.structured"] is False
    assert not any(name.startswith(("where", "candidates", "next")) for name in answer.values)
    _, (nothing,), _ = fed([0.0], "+")
    assert nothing.values["gap.closed_fraction"] is None
    assert nothing.cause is None


def test_of_effects_that_act_together_the_cause_is_the_one_that_explains_most():
    """By its Shapley share."""
    pair = verdict(
        "effect",
        ("coulomb_friction", {"torque": 0.01}),
        ("unbalance", {"e": 0.008}),
        shares=[0.1, 0.9],
    )
    _, (answer,), _ = fed([0.008], "+", lambda *_, **how: pair)
    assert answer.effects == ("coulomb_friction", "unbalance")
    assert answer.cause == "unbalance"


def test_a_diagnosis_that_fails_says_why_and_is_tried_again():
    """The loop goes on."""

    def fails(machine, experiments, **how):
        raise LdtError("too little to go by")

    diagnoser, answers, _ = fed([0.008] * 2, "++", fails)
    assert answers == [None, None]
    assert diagnoser.trouble == "too little to go by"


def test_it_can_be_broken_off():
    """From another thread, in the middle; nothing is said then, and nothing more begun."""
    begun = threading.Event()

    def endless(machine, experiments, *, tick, workers):
        while True:
            begun.set()
            tick("thinking for ever")

    diagnoser = Diagnoser(SHORT, {}, endless)
    answers = []
    signal = Signal(1, Level.POSITIVE, "threshold", 0, 1.0)
    thread = threading.Thread(target=lambda: answers.append(diagnoser.step(worn(0.008, 1), signal)))
    thread.start()
    assert begun.wait(5)
    diagnoser.cancel()
    thread.join(5)
    assert answers == [None]


def test_bad_settings_are_named():
    """As everywhere."""
    with pytest.raises(OptionError, match="diagnosis_every"):
        Diagnoser(SHORT, {"diagnosis_every": 0})


# ---- the model that learns by it

AUTO = resolve({"model": "diagnosed", "cause": "auto"})


def auto_adaptor(truth, make=None):
    adaptor = build_adaptor(build_model("diagnosed", SHORT, AUTO), AUTO)
    adaptor.diagnoser = Diagnoser(SHORT, AUTO, make or Scripted(truth))
    return adaptor


def adapted(adaptor, truth, signs):
    return [
        adaptor.step(worn(e, i), Signal(i, LEVELS[sign], "threshold", 0, 1.0))
        for i, (e, sign) in enumerate(zip(truth, signs, strict=True), 1)
    ]


def test_without_a_verdict_there_is_no_cause():
    """It predicts as the physics does, and learns nothing while the cause is unknown."""
    model = build_model("diagnosed", SHORT, AUTO)
    e = worn(0.008, 1)
    assert np.array_equal(
        model.predict(e).speed, build_model("physics", SHORT, AUTO).predict(e).speed
    )
    adaptor = auto_adaptor([0.008], lambda *_, **how: verdict("unknown"))
    ((adaptation, model),) = adapted(adaptor, [0.008], "+")
    assert adaptation.action is Action.REFUSED
    assert "no diagnosis has named a cause yet" in adaptation.reason
    assert (model.version, adaptor.diagnosis.kind) == (0, "unknown")


def test_it_learns_the_effect_that_was_named_and_says_since_when():
    """The amount in words, with its unit."""
    truth = [0.0, 0.008, 0.008, 0.010]
    steps = adapted(auto_adaptor(truth), truth, "-0++")
    (third, model), (fourth, _) = steps[2:]
    assert third.reason.startswith("since experiment 2: unbalance has grown to 8 mm; version 1")
    assert fourth.reason.startswith("since experiment 4: unbalance has grown to 10 mm; version 2")
    assert model.parameters["cause"]["effect"] == "unbalance"
    again = type(model).from_record(model.record(), SHORT, cause="auto")
    e = worn(0.008, 9)
    assert again.predict(e).speed.tobytes() == model.predict(e).speed.tobytes()


def test_an_unknown_verdict_leaves_the_cause_as_it_was():
    """The old cause goes on to be learned."""

    class Once(Scripted):
        def __call__(self, machine, experiments, **how):
            found = super().__call__(machine, experiments, **how)
            return found if len(self.asked) == 1 else verdict("unknown")

    truth = [0.008, 0.010]
    adaptor = auto_adaptor(truth, Once(truth))
    _, (second, model) = adapted(adaptor, truth, "++")
    assert adaptor.diagnosis.kind == "unknown"
    assert second.action is Action.ADAPTED
    assert model.parameters["cause"]["parameters"]["e"] == pytest.approx(0.010, rel=0.01)


def test_another_verdict_changes_the_cause():
    """And what was learned of the old one is no part of the new model."""
    model = build_model("diagnosed", SHORT, AUTO)
    _, (first,), _ = fed([0.008], "+")
    unbalanced = model.informed(first).fit([worn(0.008, 1)])
    friction = verdict("effect", ("coulomb_friction", {"torque": 0.05}))
    _, (second,), _ = fed([0.008], "+", lambda *_, **how: friction)
    other = unbalanced.informed(second)
    assert other.parameters["cause"]["effect"] == "coulomb_friction"
    assert (other.version, other.noise_std) == (unbalanced.version, None)
    assert unbalanced.informed(first) is unbalanced


def test_a_named_cause_is_not_changed_by_a_verdict():
    """Only auto asks for one."""
    model = build_model("diagnosed", SHORT, {"cause": "viscous_friction"})
    _, (answer,), _ = fed([0.008], "+")
    assert model.informed(answer) is model
    assert not model.asks_for_diagnosis


@pytest.mark.parametrize(
    ("effect", "before", "after", "words"),
    [
        ("unbalance", {"e": 0.0}, {"e": 0.0061}, "unbalance has grown to 6.1 mm"),
        ("unbalance", {"e": 0.01}, {"e": 0.002}, "unbalance has fallen to 2 mm"),
        (
            "viscous_friction",
            {"b": 0.0},
            {"b": -0.001},
            "viscous friction has changed to -0.001 N m s",
        ),
        ("inertia", {"factor": 1.0}, {"factor": 0.8}, "inertia has fallen to a factor of 0.8"),
        (
            "open_circuit",
            {"share": 0.0},
            {"share": 0.9},
            "open circuit has grown to a share of 0.9",
        ),
        (
            "asymmetric_friction",
            {"torque_forward": 0.0, "torque_backward": 0.0},
            {"torque_forward": 0.05, "torque_backward": 0.02},
            "asymmetric friction has changed to torque forward 0.05 N m, torque backward 0.02 N m",
        ),
    ],
)
def test_changes_are_said_in_words(effect, before, after, words):
    """Whether it has grown or fallen, and lengths in mm."""
    from ldt_core.effects.change_description import change_of

    assert change_of(get_effect(effect), before, after) == words


def test_the_adaptor_goes_on_from_its_state_with_the_same_cause():
    """What was named last is part of it."""
    truth = [0.008]
    adaptor = auto_adaptor(truth)
    adapted(adaptor, truth, "+")
    other = auto_adaptor(truth)
    archive = FakeArchive([worn(0.008, 1)], [adaptor.model], [adaptor.named])
    other.return_to(json.loads(json.dumps(adaptor.state())), archive)
    assert other.named == adaptor.named


def test_a_worn_rotor_is_diagnosed_and_learned_for_real():
    """From the first positive on the twin knows the cause, and what it learned is the truth."""
    machine = replace(SHORT, duration=8.0)
    settings = resolve({**AUTO, "diagnosis_after": 0, "detector": "threshold", "threshold": 2.0})
    effects = [parse_effect("unbalance:e=0.01")]
    plant = Plant(machine, degradation="none", effects=effects, seed=5, start_time=1e9)
    steps = list(Twin.from_settings(machine, settings).steps(plant.experiment(n) for n in (1, 2)))
    first = next(s for s in steps if s.diagnosis)
    assert (first.diagnosis.kind, first.diagnosis.cause) == ("effect", "unbalance")
    assert first.adaptation.reason.startswith("since experiment 1: unbalance has grown to 10 mm")
    assert first.model.parameters["cause"]["parameters"]["e"] == pytest.approx(0.01, rel=1e-3)
    assert steps[-1].signal.max_error < 1.0 < steps[-1].original.max_error(steps[-1].experiment)


def test_it_goes_on_from_what_was_recorded():
    """After any experiment: the same verdicts, of the same experiments, failures included."""
    truth, signs = [0.0] * 2 + [0.008] * 5 + [0.012] * 3, "--+++-++++"
    experiments = [worn(e, i) for i, e in enumerate(truth, 1)]
    signals = [Signal(i, LEVELS[s], "threshold", 7, 1.0) for i, s in enumerate(signs, 1)]
    _, answers, asked = fed(truth, signs, diagnosis_every=3)
    assert sum(a is not None for a in answers) >= 3
    kept = Adaptation(1, Action.KEPT, 7, "", {})
    for end in range(len(truth)):
        make = Scripted(truth)
        diagnoser = Diagnoser(SHORT, {"diagnosis_every": 3}, make)
        for e, s, answer in zip(experiments[:end], signals, answers, strict=False):
            told = Prediction(e.number, e.start, e.period, 7, e.speed)
            diagnoser.recall(RecordedStep(e, told, s, kept, None, answer))
        after = [
            diagnoser.step(*pair) for pair in zip(experiments[end:], signals[end:], strict=True)
        ]
        assert after == answers[end:]
        assert make.asked == asked[len(asked) - len(make.asked) :]


def test_a_recorded_verdict_names_no_file_to_run(tmp_path):
    """An effect of a user's own file in it is as no verdict at all; the file is not touched."""
    (tmp_path / "own.py").write_text("raise SystemExit('executed')")
    _, answers, _ = fed([0.008], "+")
    values = {f"amount.{tmp_path}/own.py:Own.x": 1.0, **answers[0].values}
    step = RecordedStep(
        worn(0.008, 1),
        Prediction(1, 1e9, SHORT.sample_period, 7, worn(0.008, 1).speed),
        Signal(1, Level.POSITIVE, "threshold", 7, 1.0),
        Adaptation(1, Action.KEPT, 7, "", {}),
        None,
        replace(answers[0], values=values),
    )
    diagnoser = Diagnoser(SHORT, {}, Scripted([0.008] * 2))
    diagnoser.recall(step)
    signal = Signal(2, Level.POSITIVE, "threshold", 7, 1.0)
    assert diagnoser.step(worn(0.008, 2), signal) is not None  # nothing explains it yet
