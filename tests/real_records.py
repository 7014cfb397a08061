"""The tables of measured machines: `python -m tests.real_records DATA [NAME ...] [--keep]`.

Every route is one that a user would take: a machine file found on one record, a diagnosis, and free
runs of records that neither has seen. The folder DATA holds `rtl_dcmotor`, `motor_generator`,
`unbalanced_disk` and `torque_pendulum`; it takes minutes for each. With --keep the tables of the
page `ldt docs real` are written anew.
"""

from __future__ import annotations

import gzip
import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ldt_core.base.experiment import Experiment
from ldt_core.base.settings import resolve
from ldt_core.calibration.calibrate import calibrate
from ldt_core.calibration.calibration import padded_range
from ldt_core.calibration.identify import identify_machine
from ldt_core.calibration.torque_balance import SPANS, Balance, balance, balanced_start, fitting
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.diagnosis.diagnosis import Diagnosis, read_effects
from ldt_core.machine.machine_file import Machine, load_machine
from ldt_core.models.physics import PhysicsModel
from ldt_core.twin.loop import Twin
from tests.benchmarks.measured_table import MeasuredTable

DISC = 25.0  # s of an experiment of the disc
LIVE = 2.0  # s of an experiment that is played live
RPM = 2 * np.pi / 60
Row = tuple[str, str, float, float]


def error(machine: Machine, experiments: list[Experiment], use=()) -> float:
    """Root mean square of free runs [rad/s]."""
    model = PhysicsModel(machine, effects=list(use))
    squares = [(model.predict(e).speed - e.speed) ** 2 for e in experiments]
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def use_of(found: Diagnosis) -> list:
    """What `ldt predict --with` takes from a diagnosis."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "diagnosis.json"
        file.write_text(json.dumps(found.as_dict()))
        return read_effects(file)


def answer(found: Diagnosis) -> str:
    """The verdict in a cell of a table."""
    groups = [" or ".join(group) for group in found.verdict.acting]
    left = found.remainder.share_of_gap
    told = f"{found.verdict.kind}: {' and '.join(groups)}".rstrip(": ")
    return told if left is None else f"{told}; {left:.0%} of the gap remains"


def pieces(u, w, period: float, length: int) -> list[Experiment]:
    """A record cut into experiments of so many samples."""
    count = len(u) // length
    cuts = [slice(k * length, (k + 1) * length) for k in range(count)]
    return [Experiment(k + 1, k * length * period, period, u[c], w[c]) for k, c in enumerate(cuts)]


def rtl_dcmotor(folder: Path) -> Iterator[Row]:
    """The file by the open loop's step; the closed loops predicted, diagnosed, and played live."""

    def record(name: str) -> list[Experiment]:
        table = np.genfromtxt(folder / f"{name}.csv", delimiter=",", names=True)
        period = float(np.median(np.diff(table["time_s"])))
        return [Experiment(1, 0.0, period, table["voltage_V"], table["speed_rpm"] * RPM)]

    names = {
        "open loop": "open_loop_5_15V",
        "closed loop a": "closed_loop_20_25_a",
        "closed loop b": "closed_loop_20_25_b",
    }
    records = {name: record(file) for name, file in names.items()}
    given, rig = load_machine("dc_motor"), records["open loop"]
    machine = calibrate(given, rig).with_recordings(["rig"]).machine
    for name, shown in records.items():
        seen = "calibrated on it" if shown is rig else "calibrated on the open loop"
        yield name, seen, error(given, shown), error(machine, shown)
    found = diagnose(machine, rig, recordings=["rig"])
    yield "open loop", answer(found), error(machine, rig), error(machine, rig, use_of(found))
    for name in ("closed loop a", "closed loop b"):
        shown, left = records[name], error(machine, records[name])
        yield name, "with the open loop's diagnosis", left, error(machine, shown, use_of(found))
        own = diagnose(machine, shown, recordings=[name])
        yield name, answer(own), left, error(machine, shown, use_of(own))
    (whole,) = records["closed loop b"]
    live = pieces(whole.voltage, whole.speed, whole.period, round(LIVE / whole.period))
    for model in ("hybrid", "auto"):
        steps = list(Twin.from_settings(machine, resolve({"model": model})).steps(live))
        for part, few in ((f"all {len(steps)}", steps), ("the last 4", steps[-4:])):
            errors = [
                float(np.mean([p.max_error(s.experiment) for s, p in both]))
                for both in ([(s, s.original) for s in few], [(s, s.prediction) for s in few])
            ]
            holds = sum(s.signal.state == "holds" for s in few)
            told = f"live, model `{model}`, {part} experiments: mean largest error; {holds} `holds`"
            yield "closed loop b", told, errors[0], errors[1]


def motor_generator(folder: Path) -> Iterator[Row]:
    """Every tenth sample of the first half in 20 experiments; the second half predicted."""
    with gzip.open(folder / "motor_generator.csv.gz", "rt") as file:
        table = np.genfromtxt(file, delimiter=",", names=True)
    u, w = table["drive"][::10], table["speed"][::10]
    first = pieces(u[:25000], w[:25000], 0.01, 1250)
    second = pieces(u[25000:], w[25000:], 0.01, 5000)
    machine = identify_machine(first, "motor_generator", offset=False, limits=(0.0, 5.0))
    machine = machine.with_recordings(["first"]).machine
    found = diagnose(machine, first, recordings=["first"])
    gap = found.gap
    yield "first half, held out", answer(found), gap.before.rmse, gap.after.rmse
    for one in found.candidates:
        if one.effect in {name for group in found.verdict.acting for name in group}:
            yield "first half, held out", f"{one.effect} alone", gap.before.rmse, one.held_out_rmse
    errors = (error(machine, second), error(machine, second, use_of(found)))
    yield ("second half, never seen", "with the first half's diagnosis", *errors)


def told(found: Balance | None) -> str:
    """The effects of a balance."""
    return "a motor" if found is None else ", ".join(found.effects)


def unbalanced_disk(folder: Path) -> Iterator[Row]:
    """What fits by accelerations; its file, whose free runs are compared with a motor's."""
    first, second = (
        np.genfromtxt(folder / f"{n}.csv", delimiter=",", names=True) for n in ("first", "second")
    )
    shown, further = (
        pieces(t["voltage_V"], t["speed_rad_s"], 0.025, len(t)) for t in (first, second)
    )
    found = fitting(shown)
    limits = padded_range(float(first["voltage_V"].min()), float(first["voltage_V"].max()))
    alone = balanced_start(balance(shown, ()), "disk", shown, limits)
    whole = balanced_start(found or balance(shown, ()), "disk", shown, limits)
    errors = (error(m, further) for m in (alone, whole))
    yield ("unbalanced disc, by accelerations", told(found), *errors)
    # The file in free run, and what the second record says that it lacks still.
    length = round(DISC / 0.025)
    first, second = (pieces(e.voltage, e.speed, 0.025, length) for (e,) in (shown, further))
    fitted = calibrate(whole, first).machine
    yield (
        "the same, second record",
        "calibrated on the first",
        error(whole, second),
        error(fitted, second),
    )
    answered = diagnose(fitted, second, recordings=["second"])
    gap = answered.gap
    yield "the same, held out", answer(answered), gap.before.rmse, gap.after.rmse


def torque_pendulum(folder: Path) -> Iterator[Row]:
    """Gravity and friction of either bob, by accelerations; the torque stands for the voltage."""
    for name in ("", "_1kg"):
        file = folder / f"control_method_energy_shaping__data_measured{name}.csv"
        table = np.genfromtxt(file, delimiter=",", names=True)
        period = float(np.median(np.diff(table["time"])))
        shown = [Experiment(1, 0.0, period, table["torque"], table["velocity"])]
        found = fitting(shown)
        span = found.span if found else SPANS[0]
        left = (balance(shown, names, span).left for names in ((), found.effects if found else ()))
        yield (f"pendulum{name.replace('_', ', ')}, change of speed", told(found), *left)


def bodies(data: Path) -> Iterator[Row]:
    """A disc and a pendulum."""
    yield from unbalanced_disk(data / "unbalanced_disk")
    yield from torque_pendulum(data / "torque_pendulum")


#: Table → what its rows are measured by, from the folder of all data.
TABLES = {
    "rtl_dcmotor": lambda data: rtl_dcmotor(data / "rtl_dcmotor"),
    "motor_generator": lambda data: motor_generator(data / "motor_generator"),
    "bodies": bodies,
}


def main(data: str = "", *given: str) -> None:
    """Measure and print the tables as Markdown, and keep them if asked to."""
    if not Path(data).is_dir() or not data:
        sys.exit(f"DATA: expected the folder of the measured records, got {data!r}; {__doc__}")
    names = [name for name in given if name != "--keep"]
    for name in names or TABLES:
        command = f"python -m tests.real_records DATA {name}"
        head = ("record", "what was done", "error before [rad/s]", "error after [rad/s]")
        table = MeasuredTable(name, command, *head, page="real")
        for record, done, before, after in TABLES[name](Path(data)):
            table.add(record, done, f"{before:.3g}", f"{after:.3g}")
        if "--keep" in given:
            table.keep()


if __name__ == "__main__":
    main(*sys.argv[1:])
