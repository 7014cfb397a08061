"""A graph that goes on with a recording whose newest model nobody can use."""

from __future__ import annotations

from dataclasses import replace

from ldt_core.base.experiment import ModelRecord
from ldt_core.base.settings import resolve
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.bag import read_bag
from ldt_core.recording.writer import KEY, BagWriter
from ldt_core.runs.offline import run
from ldt_ros.up import launch

COUNT, ENDED = 6, 4
GIVEN = resolve(
    {
        **{"machine": "dc_motor", "model": "linear", "order": 2, "gate": "none"},
        **{"detector": "threshold", "threshold": 0.2, "data": "warning-set", "seed": 2},
        **{"experiments": COUNT, "start_time": 1e9, "degradation": "none"},
        "effect": ["coulomb_friction:torque=.05"],
    }
)


def test_the_graph_leaves_the_version_and_answers_all(tmp_path):
    """Its nodes begin with the last sound one, and the summary names the other."""
    machine, sound, bag = load_machine("dc_motor"), tmp_path / "sound", tmp_path / "run"
    plant = Plant.from_settings(machine, GIVEN)
    run(machine, GIVEN, [plant.experiment(n) for n in range(1, ENDED + 1)], sound)
    there = read_bag(sound)
    newest = max(m.version for m in there.records("model"))
    assert newest > 0
    with BagWriter(bag, machine.name, settings=GIVEN, key=there.custom(KEY)) as writer:
        for raw, record in there.usable(there.messages()):
            if isinstance(record, ModelRecord) and record.version == newest:
                wrong = replace(record, parameters={**record.parameters, "offset": 1e300})
                writer.write("model", wrong, raw.time_ns / 1e9)
            else:
                writer.write_raw(raw.topic, raw.kind, raw.data, raw.time_ns)
    (one,) = launch({"resume": str(bag)})
    assert not one.summary.failures
    assert any(f"{bag}, model version {newest}: " in note for note in one.summary.notes)
    predictions = {p.number: p.model_version for p in read_bag(bag).records("prediction")}
    assert sorted(predictions) == list(range(1, COUNT + 1))
    assert predictions[ENDED + 1] == newest + 1
