"""Claims about faulty sensors: nothing is learned from them, and sound experiments all pass."""

from __future__ import annotations

from dataclasses import replace

import faulty_sensors as sensors
import numpy as np
import pytest
from faulty_sensors import FAULTS, SHORT, broken, made

from ldt_core.base.errors import OptionError
from ldt_core.base.experiment import FAULTY, Action
from ldt_core.base.settings import resolve
from ldt_core.effects import EFFECTS, get_effect
from ldt_core.machine.current_check import wrong_current
from ldt_core.machine.sensor_check import fault, sound
from ldt_core.recording.bag import read_bag
from ldt_core.restart.recorded_run import RecordedRun, complete_steps
from ldt_core.restart.stage_restart import TwinRestart
from ldt_core.runs.offline import run
from ldt_core.twin.loop import Twin

BOTH_WAYS = {"voltage": {"kind": "steps", "low": -16, "high": 16, "hold": 1}, "noise": 0.1}


def settings(**given):
    given = {"detector": "threshold", "threshold": 1.0, **given}
    return resolve({"model": "linear", "order": 1, "seed": 3, **given})


@pytest.mark.parametrize("fails", FAULTS, ids=lambda f: f.__name__)
def test_a_faulty_sensor_is_noticed_and_named(fails):
    """In each of its experiments, after sound ones and as the first that is ever seen."""
    experiments = made(12)
    for e in experiments[8:]:
        assert FAULTS[fails] in fault(SHORT, fails(e), experiments[:8])
    assert FAULTS[fails] in fault(SHORT, fails(experiments[11]))
    kept, said = sound(SHORT, broken(experiments, fails, 9, 12))
    assert [e.number for e in kept] == list(range(1, 9))
    assert "experiment 9 " in said


@pytest.mark.parametrize(
    "machine", [SHORT, replace(SHORT, simulation=BOTH_WAYS)], ids=["up", "both"]
)
def test_no_effect_of_the_machine_is_taken_for_a_faulty_sensor(machine):
    """Nor a stalled rotor, capture at resonance, or a speed that the supply's voltage ends."""
    names = [n for n in EFFECTS.names() if _may_have(machine, n)]
    assert len(names) > 20
    uses = [f"{n}:{','.join(f'{k}={v}' for k, v in get_effect(n).typical.items())}" for n in names]
    for use in [*uses, "coulomb_friction:torque=2", "unbalance:e=0.008336", "unbalance:e=0.012"]:
        for noise in (0.1, 0.0):
            kept, said = sound(machine, made(2, 1, [use], machine, noise=noise))
            assert (said, len(kept)) == ("", 2), use


def test_no_effect_of_the_machine_makes_a_current_of_another_unit_or_sign():
    """One in mA, in kA or of a clamp the other way round is one, whatever acts on most machines."""
    found = 0
    for name in [n for n in EFFECTS.names() if _may_have(SHORT, n)]:
        use = f"{name}:{','.join(f'{k}={v}' for k, v in get_effect(name).typical.items())}"
        sound = made(2, 1, [use], SHORT, measure_current=True)
        assert wrong_current(SHORT, sound) == "", name
        told = [
            wrong_current(SHORT, [replace(e, current=factor * e.current) for e in sound])
            for factor in (1000, 1e-3, -1)
        ]
        found += "times what" in told[0] and "times what" in told[1] and "wrong sign" in told[2]
    assert found > 20


def test_a_sensor_of_coarse_steps_passes():
    """It shows the same speed for long, as it did before."""
    for step in (0.01, 0.1, 1.0):
        for noise in (0.0, 0.1):
            coarse = [
                sensors.shown(e, np.round(e.speed / step) * step) for e in made(8, noise=noise)
            ]
            assert sound(SHORT, coarse)[1] == ""


def test_a_constant_speed_under_a_constant_voltage_is_no_fault():
    """A machine that runs steadily shows that, be it without any noise."""
    e = made(1)[0]
    steady = replace(e, voltage=np.full(len(e), 9.0), speed=np.full(len(e), 26.5))
    assert fault(SHORT, steady) == ""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fails", "gate"),
    [*((f, "none") for f in FAULTS), (sensors.saturates, "holdout")],
    ids=lambda v: getattr(v, "__name__", v),
)
def test_the_twin_goes_on_as_if_the_faulty_experiments_had_never_been(fails, gate):
    """Model, warning set and what is learned later are those of a twin that never saw them."""
    given = settings(gate=gate, data="evidence" if gate == "holdout" else "warning-set")
    experiments = made(14)
    spared = [e for e in experiments if not 6 <= e.number <= 9]
    steps = list(Twin.from_settings(SHORT, given).steps(broken(experiments, fails, 6, 9)))
    during = [s for s in steps if 6 <= s.experiment.number <= 9]
    for step in during:
        told = step.adaptation
        assert told.action is Action.REFUSED
        assert told.details[FAULTY] == 1
        assert FAULTS[fails] in told.reason
        assert step.model is None
    others = [s for s in steps if s not in during]
    assert any(s.model is not None for s in others)  # it does learn
    for step, alone in zip(others, Twin.from_settings(SHORT, given).steps(spared), strict=True):
        assert np.array_equal(step.prediction.speed, alone.prediction.speed)
        assert step.adaptation == alone.adaptation


def test_without_the_check_the_same_twin_learns_from_them():
    """The refusals above are the check's doing; `--no-sensor-check` is there for odd sensors."""
    given = settings(gate="none", data="warning-set", sensor_check=False)
    steps = list(Twin.from_settings(SHORT, given).steps(broken(made(9), sensors.saturates, 6, 9)))
    assert any(s.model is not None for s in steps[5:])
    with pytest.raises(OptionError, match="sensor_check"):
        settings(sensor_check="perhaps")


@pytest.mark.slow
def test_a_run_with_a_faulty_sensor_goes_on_from_its_recording(tmp_path):
    """Recalled to any step, the twin is the one that ran through."""
    given = settings(detector="adequacy", experiments=14)
    experiments = broken(made(14), sensors.sticks, 5, 8)
    steps = list(Twin.from_settings(SHORT, given).steps(experiments))
    assert sum(FAULTY in s.adaptation.details for s in steps) == 4
    run(SHORT, given, experiments, tmp_path / "run")
    told = list(complete_steps(read_bag(tmp_path / "run"), SHORT))
    for end in (5, 6, 9, 12):
        twin = Twin.from_settings(SHORT, given)
        restart = TwinRestart(twin, RecordedRun("", "", SHORT), pytest.fail)
        for step in told[:end]:
            restart.recall(step)
        remembered = twin.adaptor.memory.recent
        for ran, step in zip(steps[end:], twin.steps(experiments[end:]), strict=True):
            assert ran.adaptation == step.adaptation
            assert np.array_equal(ran.prediction.speed, step.prediction.speed)
        assert not {5, 6, 7, 8} & {e.number for e in remembered}


def _may_have(machine, name):
    try:
        get_effect(name).require(machine.model)
    except OptionError:
        return False
    return True
