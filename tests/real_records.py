"""The table of measured machines: `python tests/real_records.py DATA [NAME...]`.

Every route is one that a user would take: a machine file found on one record, a diagnosis, and free
runs of records that neither has seen. The folder DATA holds `rtl_dcmotor`, `motor_generator`,
`unbalanced_disk` and `torque_pendulum`; it takes minutes for each.
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
from ldt_core.calibration.calibrate import calibrate
from ldt_core.calibration.identify import identify_machine, widened
from ldt_core.calibration.torque_balance import SPANS, Balance, balance, fitting, machine_of
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.diagnosis.diagnosis import Diagnosis, read_effects
from ldt_core.machine.machine_file import Machine, load_machine
from ldt_core.models.physics import PhysicsModel

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


def row(name: str, machine: Machine, shown, further, recordings=()) -> Row:
    """A record diagnosed, and the error on records that it has not seen, before and after."""
    found = diagnose(machine, shown, recordings=recordings)
    groups = [" or ".join(group) for group in found.verdict.acting]
    answer = f"{found.verdict.kind}: {', '.join(groups)}".rstrip(": ")
    return name, answer, error(machine, further), error(machine, further, use_of(found))


def pieces(u, w, period: float, length: int) -> list[Experiment]:
    """A record cut into experiments of so many samples."""
    count = len(u) // length
    cuts = [slice(k * length, (k + 1) * length) for k in range(count)]
    return [Experiment(k + 1, k * length * period, period, u[c], w[c]) for k, c in enumerate(cuts)]


def rtl_dcmotor(folder: Path) -> Iterator[Row]:
    """The file by the open loop's step; the closed loops diagnosed, each predicted by the other."""

    def record(name: str) -> list[Experiment]:
        table = np.genfromtxt(folder / f"{name}.csv", delimiter=",", names=True)
        period = float(np.median(np.diff(table["time_s"])))
        return [Experiment(1, 0.0, period, table["voltage_V"], table["speed_rpm"] * RPM)]

    rig, a, b = (
        record(n) for n in ("open_loop_5_15V", "closed_loop_20_25_a", "closed_loop_20_25_b")
    )
    machine = calibrate(load_machine("dc_motor"), rig).with_recordings(["rig"]).machine
    yield row("rt-l, open loop", machine, rig, [*a, *b], ["rig"])
    yield row("rt-l, closed loop a", machine, a, b, ["a"])
    yield row("rt-l, closed loop b", machine, b, a, ["b"])


def motor_generator(folder: Path) -> Iterator[Row]:
    """Every tenth sample of the first half in 20 experiments; the second half predicted."""
    with gzip.open(folder / "motor_generator.csv.gz", "rt") as file:
        table = np.genfromtxt(file, delimiter=",", names=True)
    u, w = table["drive"][::10], table["speed"][::10]
    first = pieces(u[:25000], w[:25000], 0.01, 1250)
    second = pieces(u[25000:], w[25000:], 0.01, 5000)
    found = identify_machine(first, "motor_generator", offset=False, limits=(0.0, 5.0))
    machine = found.with_recordings(["first"]).machine
    yield row("motor and generator", machine, first, second, ["first"])


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
    limits = widened(float(first["voltage_V"].min()), float(first["voltage_V"].max()))
    alone = machine_of(balance(shown, ()), "disk", shown, limits)
    whole = machine_of(found or balance(shown, ()), "disk", shown, limits)
    errors = (error(m, further) for m in (alone, whole))
    yield ("unbalanced disc, by accelerations", told(found), *errors)


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


RECORDS = (rtl_dcmotor, motor_generator, unbalanced_disk, torque_pendulum)


def main(data: str, *names: str) -> None:
    """Print the table as Markdown."""
    print("| record | answer | error without [rad/s] | with |\n|---|---|---|---|", flush=True)
    for record in RECORDS:
        if names and record.__name__ not in names:
            continue
        for name, answer, before, after in record(Path(data) / record.__name__):
            print(f"| {name} | {answer} | {before:.3g} | {after:.3g} |", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
