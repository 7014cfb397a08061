"""Claims about the advice: folds where the simulation jumps, margins, ways past, and its limits."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ldt_core.advice.advise import NO_FOUNDATION, advise
from ldt_core.advice.bands import (
    captured_seconds,
    in_bands,
    margins,
    uncertain_bands,
    voltage_bands,
)
from ldt_core.advice.experiment_design import candidate_designs, most_informative
from ldt_core.advice.machine_estimate import MachineEstimate, estimate_machine, with_effects
from ldt_core.advice.run_up import plan_run_up
from ldt_core.base.errors import ModelError, OptionError, RecordingError
from ldt_core.base.experiment import AdviceRecord, DiagnosisRecord, Experiment, ModelRecord
from ldt_core.base.settings import resolve
from ldt_core.effects import get_effect
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.physics.steady_state import steady_voltage
from ldt_core.recording import codec
from ldt_core.recording.bag import read_bag
from ldt_core.runs.fleet_members import roles
from ldt_core.runs.offline import run
from ldt_core.twin import advisor as advisor_module
from ldt_core.twin.advisor import Advisor
from ldt_core.views.figures.advice_figure import PERIOD, heedless

ROTOR = load_machine("rotor")
SHORT = replace(ROTOR, duration=4.0, sample_period=0.02)
LIMIT = 24.0


def rotor(e: float) -> dict[str, float]:
    return {**ROTOR.parameters, "e": e}


def simulated(values, volts, period=PERIOD) -> np.ndarray:
    start = ROTOR.model.initial_state(values, 0.0)
    return ROTOR.model.simulate(values, volts, period, start)[:, 1]


def measured(volts, speed, number=1, period=PERIOD) -> Experiment:
    return Experiment(number, 1e9 + number, period, volts, speed)


def learned(e: float, version: int = 3) -> ModelRecord:
    cause = {"effect": "unbalance", "parameters": {"e": e}}
    return ModelRecord(version, "diagnosed", (1,), {"cause": cause})


# ---- bands


def test_a_band_is_bounded_by_folds():
    """At which a slow ramp jumps, as `test_rotor.py` shows by a simulation."""
    bands = voltage_bands(rotor(0.008336), LIMIT)
    assert [(round(b.low, 2), round(b.high, 2)) for b in bands] == [(6.15, 8.0), (10.99, 16.04)]


@given(e=st.floats(1e-4, 0.02), b=st.floats(0.5, 2.0), r=st.floats(0.5, 3.0))
@settings(max_examples=30)
def test_a_band_lies_between_two_folds(e, b, r):
    """Two stable speeds at each of its ends, in order, and with more doubt never less to avoid."""
    values = {**rotor(e), "b": 0.01 * b, "R_x": 5 * r, "R_y": 10 * r}
    bands = voltage_bands(values, LIMIT)
    for band in bands:
        assert band.low < band.high
        assert band.held[0] <= band.held[1] < band.free[0] <= band.free[1]
        assert steady_voltage(values, band.held[1]) == pytest.approx(band.high)
        assert steady_voltage(values, band.free[0]) == pytest.approx(band.low)
        edges = np.array([band.low, min(band.high, LIMIT)])
        assert in_bands(np.concatenate([edges, -edges]), uncertain_bands(values, LIMIT)).all()
    more = voltage_bands({**values, "e": 1.1 * e}, LIMIT)
    assert max((x.high for x in bands), default=0) <= max((x.high for x in more), default=0)


def test_without_eccentricity_or_foundation_there_is_no_band():
    """An ideal rotor, and a motor alone."""
    assert voltage_bands(rotor(0.0), LIMIT) == []
    assert voltage_bands(load_machine("dc_motor").parameters, LIMIT) == []
    assert uncertain_bands(rotor(0.0), LIMIT) == []


def test_capture_is_told_from_passing_through():
    """A ramp that ends captured counts; a step past the resonance does not."""
    values = rotor(0.01)
    bands = voltage_bands(values, LIMIT)
    ramp = np.minimum(np.arange(0, 20, PERIOD) / 10, 1.0) * 14
    caught = captured_seconds(values, bands, measured(ramp, simulated(values, ramp)))
    step = np.full(ramp.size, 22.0)
    assert caught > 8
    assert captured_seconds(values, bands, measured(step, simulated(values, step))) == 0
    assert captured_seconds(values, bands, measured(-ramp, -simulated(values, ramp))) == caught


# ---- margins


@given(b=st.floats(0.3, 3.0), r=st.floats(0.5, 3.0), k=st.floats(0.7, 1.4))
@example(b=1.0, r=0.53125, k=0.8657820729374943)  # two folds within a step of the grid
@settings(max_examples=20)
def test_margins_are_where_the_bands_change(b, r, k):
    """A band appears at the one, and ends at the limit with the other."""
    values = {**ROTOR.parameters, "b": 0.01 * b, "R_x": 5 * r, "R_y": 10 * r, "K_y": 6000 * k}
    found = margins(values, LIMIT)
    assert voltage_bands({**values, "e": 0.99 * found.first_fold}, LIMIT) == []
    assert voltage_bands({**values, "e": 1.02 * found.first_fold}, LIMIT)
    if found.no_way_through is not None:
        ends = [x.high for x in voltage_bands({**values, "e": found.no_way_through}, LIMIT)]
        assert min(abs(x - LIMIT) for x in ends) < 1e-3 * LIMIT


def test_margins_of_the_rotor_are_the_known_ones():
    """First fold from 1.99 mm on; a motor has none."""
    assert margins(ROTOR.parameters, LIMIT).first_fold == pytest.approx(1.99e-3, abs=1e-5)
    alone = margins(load_machine("dc_motor").parameters, LIMIT)
    assert alone.first_fold is None is alone.no_way_through


# ---- a way to a speed


@pytest.mark.parametrize("angle", [0.0, 1.5, 3.0, 4.5])
def test_following_the_advice_avoids_the_capture(angle):
    """The same speed: raised evenly the rotor stays below 31 rad/s, as advised it gets to 40."""
    values = rotor(0.01)
    way = plan_run_up(ROTOR, values, 40.0)
    assert way.through is not None
    for true_e, tolerance in ((0.01, 0.1), (0.0096, 0.6), (0.0104, 0.6)):
        start = ROTOR.model.initial_state(values, 0.0)
        start[0] = angle
        volts = heedless(way, 20.0)
        ends = [
            ROTOR.model.simulate(rotor(true_e), v, PERIOD, start)[-100:, 1].mean()
            for v in (volts, way.volts(volts.size, PERIOD))
        ]
        assert ends[0] < 31
        assert ends[1] == pytest.approx(40, abs=tolerance)


def test_where_nothing_can_happen_the_voltage_is_set_at_once():
    """Below all bands, above all bands, and for an ideal rotor."""
    assert plan_run_up(ROTOR, rotor(0.01), 10.0).through is None
    assert plan_run_up(ROTOR, rotor(0.01), 64.0).through is None
    assert plan_run_up(ROTOR, rotor(0.0), 40.0).through is None


def test_the_voltage_that_holds_a_speed_counts_all_that_acts():
    """A drag and a dry friction, one known to the file and one found, as an equation has them."""
    motor = load_machine("dc_motor")
    torque, c, speed = 0.05, 2e-5, 100.0
    known = motor.with_effects([get_effect("coulomb_friction").used({"torque": torque})])
    belief = with_effects(known, [get_effect("quadratic_drag").used({"c": c})])
    p = motor.parameters
    load = torque + c * speed**2 + p["b"] * speed
    holds = p["R"] / p["K_t"] * load + p["K_t"] * speed
    way = plan_run_up(known, belief.values, speed, belief.beside)
    assert way.through is None
    assert way.voltage == pytest.approx(holds, abs=1e-3 * motor.voltage_limits[1])
    with pytest.raises(OptionError, match="a speed that 24 V can hold"):
        plan_run_up(known, belief.values, 300.0, belief.beside)


def test_a_friction_that_holds_the_shaft_is_overcome_first():
    """It takes less voltage to go on turning than to break away."""
    motor = load_machine("dc_motor")
    stuck = get_effect("stribeck_friction").used({"torque": 0.05, "static": 0.3, "velocity": 5.0})
    belief = with_effects(motor, [stuck])
    way = plan_run_up(motor, belief.values, 20.0, belief.beside)
    assert way.through is not None
    assert way.through > way.voltage
    assert "does not lead there" in way.describe()
    start = motor.model.initial_state(belief.values, 0.0)
    for volts, speed in ((np.full(2000, way.voltage), 0.0), (way.volts(2000, PERIOD), 20.0)):
        end = motor.model.simulate(belief.values, volts, PERIOD, start, belief.beside)[-100:, 1]
        assert end.mean() == pytest.approx(speed, abs=0.4)


@pytest.mark.parametrize(
    ("e", "speed", "words"),
    [
        (0.01, 30.0, "below 27.4 or above 31.6 rad/s"),
        (0.01, 200.0, "a speed that 24 V can hold"),
        (0.014, 50.0, "a speed to which 24 V lead for certain"),
        (0.01, -1.0, "a finite speed above 0 rad/s"),
    ],
)
def test_a_speed_that_cannot_be_held_or_reached_is_refused(e, speed, words):
    """With the reason."""
    with pytest.raises(OptionError, match=words):
        plan_run_up(ROTOR, rotor(e), speed)


# ---- what would teach most


@pytest.mark.slow
@given(e=st.floats(0.0, 0.012), reverse=st.booleans())
@example(e=0.005929865435612752, reverse=False)  # a level next to a band
@settings(max_examples=25)
def test_no_lesson_holds_a_voltage_to_avoid_or_beyond_the_limits(e, reverse):
    """Whatever the eccentricity; the machine is reversed only where it was before."""
    for design in candidate_designs(ROTOR, rotor(e), reverse):
        volts = design.volts(ROTOR.samples, ROTOR.sample_period)
        assert not in_bands(volts, uncertain_bands(rotor(e), LIMIT)).any()
        assert np.abs(volts).max() <= LIMIT
        assert reverse or volts.min() >= 0


def test_what_was_measured_already_teaches_less():
    """And the parameter that it would sharpen is one of the machine's."""
    machine = replace(load_machine("dc_motor"), duration=4.0, sample_period=0.02)
    first = most_informative(machine, machine.parameters)
    volts = first.volts(machine.samples, machine.sample_period)
    start = machine.model.initial_state(machine.parameters, 0.0)
    speed = machine.model.simulate(machine.parameters, volts, 0.02, start)[:, 1]
    noisy = speed + np.random.default_rng(0).normal(0, 0.1, speed.size)
    again = most_informative(
        machine, machine.parameters, [measured(volts, noisy, n, 0.02) for n in (1, 2)]
    )
    assert 0 < again.bits < first.bits
    assert again.sharpens in machine.parameters


# ---- what it goes by


def test_a_model_that_has_learned_comes_before_a_diagnosis_and_that_before_the_file():
    """Each named as the source."""
    told = {"verdict.kind": "effect", "amount.unbalance.e": 0.004}
    diagnosis = DiagnosisRecord(7, 0, "because", ("unbalance",), told)
    assert estimate_machine(ROTOR, learned(0.006), diagnosis).values["e"] == 0.006
    assert estimate_machine(ROTOR, learned(0.006), diagnosis).source == "model 3"
    assert estimate_machine(ROTOR, learned(0.0, 0), diagnosis).values["e"] == 0.004
    assert estimate_machine(ROTOR, None, diagnosis).source == "the diagnosis at 7"
    assert estimate_machine(ROTOR).source == "the machine file"


def test_what_the_default_model_has_learned_is_known():
    """The causes and the machine's own parameters of a grey box; without causes a diagnosis."""
    own = {**ROTOR.parameters, "K_t": 1.01 * ROTOR.parameters["K_t"]}
    effects = {"unbalance": {"e": 0.006}, "coulomb_friction": {"torque": 0.1}}
    record = ModelRecord(3, "grey_box", (4,), {"machine": own, "effects": effects})
    belief = estimate_machine(ROTOR, record)
    assert (belief.source, belief.left_out) == ("model 3", ("coulomb_friction",))
    assert belief.values["e"] == 0.006
    assert belief.values["K_t"] == own["K_t"]
    told = {"verdict.kind": "effect", "amount.unbalance.e": 0.004}
    diagnosis = DiagnosisRecord(7, 0, "because", ("unbalance",), told)
    bare = ModelRecord(3, "grey_box", (4,), {"machine": own, "effects": {}})
    assert estimate_machine(ROTOR, bare, diagnosis).values["e"] == 0.004
    with pytest.raises(ModelError, match="effects and a machine"):
        estimate_machine(ROTOR, ModelRecord(1, "grey_box", (), {"effects": 3}))


def test_effects_that_are_not_parameters_are_named_as_left_out():
    """They shift the voltages, by how much is not computed."""
    told = {"verdict.kind": "effect", "amount.unbalance.e": 0.01}
    told |= {"amount.coulomb_friction.torque": 0.1, "amount.my_own.c": 1.0}
    both = DiagnosisRecord(7, 0, "because", ("unbalance", "coulomb_friction"), told)
    belief = estimate_machine(ROTOR, None, both)
    assert belief.left_out == ("coulomb_friction", "my_own")
    assert "Not counted in: coulomb friction and my own" in advise(SHORT, belief).sentence


def test_a_model_without_its_cause_is_refused():
    """It came from outside."""
    with pytest.raises(ModelError, match=r"parameters\.cause"):
        estimate_machine(ROTOR, ModelRecord(1, "diagnosed", (), {"cause": {"effect": "unbalance"}}))
    with pytest.raises(OptionError):
        estimate_machine(ROTOR, learned(-1.0))


# ---- advices


def test_a_machine_without_foundation_is_told_that_there_is_no_such_advice():
    """Margin and next experiment there are all the same."""
    machine = replace(load_machine("dc_motor"), duration=4.0, sample_period=0.02)
    volts = np.full(200, 12.0)
    advice = advise(machine, MachineEstimate(machine.parameters, "the machine file"), [
        measured(volts, 0 * volts, 4, 0.02)
    ])  # fmt: skip
    assert advice.sentence.startswith(NO_FOUNDATION)
    assert "12 V are left to the limit of 24 V." in advice.sentence
    assert "Most would be learned from " in advice.sentence
    assert not advice.warning
    assert advice.values["bands"] == 0


def test_a_model_that_knows_no_eccentricity_is_told_so():
    """No band is not the same as none known."""
    blind = ModelRecord(2, "hybrid", (), {})
    words = advise(SHORT, estimate_machine(SHORT, blind), (), blind).sentence
    assert words.startswith("No advice on voltages to avoid: the hybrid model and the machine file")
    assert advise(SHORT, MachineEstimate(rotor(0.001), "x")).sentence.startswith(
        "No voltage to avoid"
    )


def test_a_machine_in_or_near_a_band_is_warned():
    """And one outside is not; the sentence has the band's voltages."""
    belief = estimate_machine(SHORT, learned(0.01))
    for volts, warned in ((14.0, True), (19.2, True), (-14.0, True), (10.5, False), (21.0, False)):
        row = np.full(200, volts)
        advice = advise(SHORT, belief, [measured(row, np.abs(row) * 3, 2, 0.02)], learned(0.01))
        assert advice.warning == warned
        assert "Do not hold 6.25 to 9.1 V and 11.2 to 18.9 V" in advice.sentence
        assert (advice.values["experiment.share_in_or_near"] == 1) == warned
    assert advice.values["margin.voltage"] == 3.0
    assert advice.model_version == 3


@given(numbers=st.lists(st.integers(1, 60), unique=True), every=st.integers(1, 9))
@settings(max_examples=50)
def test_there_is_at_most_one_advice_in_so_many_experiments(numbers, every):
    """The first experiment has one, and none is closer to the last one than that."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            advisor_module, "advise", lambda m, b, e, *_: AdviceRecord(e[-1].number, 0, False, "")
        )
        advisor = Advisor(SHORT, {"advice_every": every})
        rest = np.zeros(3)
        made = [advisor.step(measured(rest, rest, n), learned(0.01)) for n in sorted(numbers)]
    given_at = [a.experiment for a in made if a is not None]
    assert given_at[:1] == sorted(numbers)[:1]
    assert all(b - a >= every for a, b in itertools.pairwise(given_at))


words = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20)


@given(
    number=st.integers(0, 2**53),
    warning=st.booleans(),
    sentence=words,
    value=st.none() | st.booleans() | st.floats(allow_nan=False, allow_infinity=False),
    word=words.filter(lambda w: w != "null"),
)
@pytest.mark.slow
def test_an_advice_comes_back_as_it_was_sent(number, warning, sentence, value, word):
    """Numbers bit-equal, words as they are."""
    sent = AdviceRecord(number, 3, warning, sentence, {"band.1.low": value, "next.name": word})
    assert codec.decode("advice", codec.encode(sent, time=1.0, machine="rotor")) == sent


def test_what_is_no_advice_is_refused():
    """An error is none: nothing here has failed."""
    message = codec.encode(AdviceRecord(1, 0, True, "because"))
    message.status[0].level = 2
    with pytest.raises(RecordingError, match="OK"):
        codec.decode("advice", message)


# ---- runs


def test_off_by_default(tmp_path):
    """No node, no topic, no word."""
    given = resolve({"model": "physics", "experiments": 1})
    assert "advisor" not in roles(given)
    assert "advisor" in roles({**given, "advice": True})
    plant = Plant.from_settings(SHORT, given)
    summary = run(SHORT, given, [plant.experiment(1)], tmp_path / "bag")
    assert summary.as_dict()["advice"] is None
    assert read_bag(tmp_path / "bag").topic("advice") is None


def test_a_run_records_the_advices_that_are_due(tmp_path):
    """Each behind its adaptation; the summary has the last one."""
    given = resolve({"model": "physics", "experiments": 5, "advice": True, "advice_every": 3})
    machine = SHORT.with_parameters(e=0.01)
    plant = Plant.from_settings(machine, {**given, "degradation": "none"})
    summary = run(machine, given, map(plant.experiment, range(1, 6)), tmp_path / "bag")
    advices = list(read_bag(tmp_path / "bag").records("advice"))
    assert [a.experiment for a in advices] == [1, 4]
    assert summary.advice == advices[-1]
    assert advices[-1].warning
    assert advices[-1].values["source"] == "the machine file"
