"""What a prediction uses and a sentence may not claim."""

from __future__ import annotations

import numpy as np
import pytest

from ldt_core.base.experiment import Experiment
from ldt_core.effects import get_effect
from ldt_core.machine.machine_file import load_machine
from ldt_core.machine.plant import Plant
from ldt_core.models.causes import Doubts
from ldt_core.models.grey_box import GreyBoxModel
from ldt_core.twin.cause_doubts import doubts
from tests.motors import motor_file

DC = load_machine("dc_motor")
PLAIN = GreyBoxModel(DC)
LOAD, HEATING = "constant_load", "winding_heating"


def version(number, name, **amounts):
    """In which one effect acts; its amounts are known to 2 %."""
    given = {name: {n: float(v) for n, v in amounts.items()}}
    ends = {name: {n: sorted((0.98 * v, 1.02 * v)) for n, v in amounts.items()}}
    told = {**PLAIN.parameters, "effects": given, "intervals": ends}
    return GreyBoxModel(DC, told, number)


def with_inertia(model):
    """The same version, with twice the inertia in front."""
    given = {"inertia": {"factor": 2.0}, **model.parameters["effects"]}
    ends = {"inertia": {"factor": [1.9, 2.1]}, **model.parameters["intervals"]}
    return GreyBoxModel(DC, {**model.parameters, "effects": given, "intervals": ends}, 1)


def row(name, *amounts):
    """Versions with these amounts, one after the other."""
    return [version(i, name, **given) for i, given in enumerate(amounts, 1)]


def doubt(versions, experiment):
    *earlier, model = versions
    return doubts(model, earlier[-1], earlier, [experiment])[0]


@pytest.fixture(scope="module")
def loaded():
    """An experiment that no parameters within tolerance explain without its load."""
    use = [get_effect(LOAD).used({"torque": 0.05})]
    return Plant(DC, experiments=1, seed=8, degradation="none", effects=use).experiment(1)


@pytest.mark.parametrize(
    ("torques", "known"),
    [
        ([0.02, 0.03, 0.05], True),  # grows
        ([0.02, 0.04, 0.03, 0.02, 0.05], False),  # another one each time
        ([0.02, 0.08, 0.06, 0.05], True),  # is repaired
        ([0.02, 0.0201, 0.02, 0.0201, 0.05], True),  # known no better than that
    ],
)
def test_an_amount_that_goes_up_and_down_is_not_told(loaded, torques, known):
    """Each statement contradicts the last one; wear and one repair do not."""
    found = doubt(row(LOAD, *({"torque": t} for t in torques)), loaded)
    assert found == ({} if known else {LOAD: f"the {LOAD.replace('_', ' ')} {EACH_TIME}"})


EACH_TIME = "that explains it is another one each time"


def test_what_is_the_machines_for_good_does_not_change(loaded):
    """A warming of another time constant is another cause, or began warm."""
    warm = [{"thermal_resistance": 3.0, "time_constant": t} for t in (50.0, 20.0)]
    first, last = row(HEATING, *warm)
    for versions in ([PLAIN, first, last], [first, PLAIN, last]):
        found = doubt(versions, loaded)
        assert EACH_TIME in found[HEATING]
        assert "temperature rise at the start" in found[HEATING]


def test_versions_before_it_went_are_no_part_of_the_row(loaded):
    """A load that has gone comes again by another amount."""
    up, down, last = row(LOAD, {"torque": 0.02}, {"torque": 0.04}, {"torque": 0.05})
    assert doubt([up, down, up, PLAIN, last], loaded) == {}


def test_a_cause_that_the_machines_tolerances_do_without_is_not_told(loaded):
    """That it acts would rest on the machine not having changed between two experiments."""
    healthy = Plant(DC, experiments=1, seed=8, degradation="none").experiment(1)
    acting = version(1, LOAD, torque=0.05)
    words = "the machine's own parameters explain it without constant load, too"
    assert doubt([PLAIN, acting], healthy) == {LOAD: words}
    assert doubt([PLAIN, acting], loaded) == {}
    change = acting.change(PLAIN, Doubts({LOAD: words}))
    assert change == f"what has changed is not known: {words}"


@pytest.mark.parametrize(("heavier", "resistance", "known"), [(1.0, 1.5, True), (1.5, 1.0, False)])
def test_a_resistance_that_the_measured_current_contradicts_is_not_told(heavier, resistance, known):
    """A load one and a half times as heavy, friction and all, by equations of its own.

    The speed is that of a resistance one and a half times as large. That was named, to 1 %.
    """
    p = {"J": 0.002, "K_t": 0.05, "R": 1.0, "L": 0.0, "b": 1e-4}
    random, step, w = np.random.default_rng(1), 2e-4, 0.0
    volts, speed, current = np.repeat(random.uniform(-20, 20, 12), 50), [], []
    for u in volts.tolist():
        speed.append(w)
        current.append((u - p["K_t"] * w) / resistance)
        for _ in range(50):
            torque = p["K_t"] * (u - p["K_t"] * w) / resistance - heavier * p["b"] * w
            w += step * torque / (heavier * p["J"])
    noise = random.standard_normal((2, volts.size))
    told = speed + 0.1 * noise[0], current + 0.02 * noise[1]
    experiment = Experiment(1, 0.0, 0.01, volts, *map(np.asarray, told))
    before = GreyBoxModel(motor_file(p, 600, 0.01))
    ends = {"armature_resistance": {"factor": [1.49, 1.51]}}
    given = {"effects": {"armature_resistance": {"factor": 1.5}}, "intervals": ends}
    model = GreyBoxModel(before.machine, {**before.parameters, **given}, 1)
    found = doubts(model, before, [before], [experiment])[0].get("armature_resistance", "")
    assert ("the measured current speaks against" in found) is not known


def test_a_friction_is_not_contradicted_by_a_current_that_other_numbers_move():
    """A fit to the speed moves K_t within its tolerance; the file's fits the current better."""
    use = [get_effect("coulomb_friction").used({"torque": 0.02})]
    how = {"degradation": "none", "effects": use, "measure_current": True}
    plant = Plant(DC, experiments=1, seed=8, **how)
    told = version(1, "coulomb_friction", torque=0.02).parameters
    moved = {**told["machine"], "K_t": 1.02 * DC.parameters["K_t"]}
    model = GreyBoxModel(DC, {**told, "machine": moved}, 1)
    assert doubt([PLAIN, model], plant.experiment(1)) == {}


@pytest.mark.parametrize(("torque", "stays"), [(0.05, {LOAD}), (0.1, set())])
def test_what_may_as_well_act_as_before_has_not_changed(torque, stays):
    """An inertia that doubles moves the fit of a load; a load that doubles does not stay."""
    before = version(1, LOAD, torque=0.05)
    use = [get_effect(LOAD).used({"torque": torque}), get_effect("inertia").used({"factor": 2.0})]
    plant = Plant(DC, experiments=1, seed=8, degradation="none", effects=use)
    model = with_inertia(version(2, LOAD, torque=1.1 * torque))
    found = doubts(model, before, [PLAIN, before], [plant.experiment(1)])
    assert set(found.stays) == stays
    assert "inertia" in found.moves


def test_a_like_law_in_the_place_of_another_is_no_change(loaded):
    """A dry friction that is told forward and backward is the same friction."""
    dry = version(1, "coulomb_friction", torque=0.05)
    both = version(2, "asymmetric_friction", torque_forward=0.05, torque_backward=0.05)
    found = doubts(both, dry, [PLAIN, dry], [loaded], hardly=True)
    place = "asymmetric friction explains it in the place of coulomb friction"
    assert found.unknown["asymmetric_friction"] == place
    found = doubts(both, dry, [PLAIN, dry], [loaded])
    assert found.unknown.get("asymmetric_friction") != place


def test_twice_the_inertia_may_be_twice_the_resistance():
    """With half of the torques, which the file hardly knows; but for the winding's inductance."""
    use = [get_effect("inertia").used({"factor": 2.0}), get_effect(LOAD).used({"torque": 0.05})]
    plant = Plant(DC, experiments=1, seed=8, degradation="none", effects=use, noise=1.0)
    model = with_inertia(version(1, LOAD, torque=0.05))
    found = doubts(model, PLAIN, [PLAIN], [plant.experiment(1)])
    assert {"armature resistance", "source resistance"} <= set(found.strained["inertia"])
