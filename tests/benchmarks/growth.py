"""How the time of a study grows with experiments, samples and seeds, as a table.

python -m tests.benchmarks.growth [--keep]

Processor time of the runs of the paper's table in one process, without the drawing of the page. A
busy machine does not stretch it; on an idle one it is the time that passes, and so many processes
as there are cores divide it.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import yaml

import msgs_config
from ldt_core.lab.study.engine import conduct
from ldt_core.lab.study.study_plan import StudyPlan
from tests.benchmarks.measured_table import MeasuredTable

BASE = {"seeds": 1, "experiments": 100, "samples": 1000}
POINTS = {"seeds": (1, 2, 4), "experiments": (50, 100, 200), "samples": (500, 1000, 2000)}
PERIOD = 0.01  # s


def rotor(folder: Path, samples: int) -> str:
    """The rotor with experiments of so many samples."""
    data = yaml.safe_load(msgs_config.machine_text("rotor"))
    data["experiment"] = {"duration": samples * PERIOD, "sample_period": PERIOD}
    file = folder / f"rotor_{samples}.yaml"
    file.write_text(yaml.safe_dump(data))
    return str(file)


def measure(seeds: int, experiments: int, samples: int) -> tuple[float, int]:
    """Processor time [s] of a study of that size, and how many models it trained."""
    with tempfile.TemporaryDirectory() as folder:
        plan = StudyPlan(seeds, experiments, rotor(Path(folder), samples), ("paper",))
        begin = time.process_time()
        study = conduct(plan, Path(folder) / "study", jobs=1)
        spent = time.process_time() - begin
    return spent, sum(len(r.adaptations) for r in study.results())


def main() -> int:
    """Measure and print."""
    measure(1, 12, 500)  # compiled code is loaded
    head = ("seeds", "experiments", "samples", "processor time", "trainings")
    table = MeasuredTable("growth", "python -m tests.benchmarks.growth", *head)
    sizes = [{**BASE, name: value} for name, values in POINTS.items() for value in values]
    for size in {tuple(s.items()): s for s in sizes}.values():
        spent, trainings = measure(**size)
        table.add(*size.values(), f"{spent:.1f} s", trainings)
    if "--keep" in sys.argv[1:]:
        table.keep()
    return 0


if __name__ == "__main__":
    sys.exit(main())
