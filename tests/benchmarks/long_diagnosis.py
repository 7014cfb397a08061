"""How time and memory of a diagnosis grow with the samples of its experiments, as a table.

python -m tests.benchmarks.long_diagnosis [--keep] [SAMPLES ...]

Six experiments of the geared motor at 100 Hz, with a dry friction that its file does not know. Each
size has a process of its own. Seconds are those of the processor, without reading and drawing.
"""

from __future__ import annotations

import multiprocessing
import resource
import sys
import time
from dataclasses import replace

from ldt_core.base.settings import resolve
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from tests.benchmarks.measured_table import MeasuredTable

SIZES = (1_000, 4_000, 16_000, 64_000, 256_000)
COUNT, PERIOD = 6, 0.01  # experiments, s
EFFECT = "coulomb_friction:torque=0.05"


def measure(samples: int) -> tuple[float, float, str]:
    """Seconds of the diagnosis, memory of its process at most [MB], and its verdict."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(_measure, (samples,))


def _measure(samples: int) -> tuple[float, float, str]:
    machine = replace(load_machine("dc_motor"), duration=samples * PERIOD)
    given = resolve({"seed": 3, "effect": [EFFECT], "degradation": "none"})
    plant = Plant.from_settings(machine, given)
    made = [plant.experiment(number) for number in range(1, COUNT + 1)]
    begin = time.process_time()
    found = diagnose(machine, made, workers=1).verdict
    spent = time.process_time() - begin
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    return spent, memory, " or ".join(" / ".join(group) for group in found.acting) or found.kind


def main() -> int:
    """Measure and print."""
    head = ("samples per experiment", "processor time", "memory", "verdict")
    table = MeasuredTable("diagnosis", "python -m tests.benchmarks.long_diagnosis", *head)
    keep = "--keep" in sys.argv[1:]
    for samples in [int(a) for a in sys.argv[1:] if a != "--keep"] or SIZES:
        spent, memory, verdict = measure(samples)
        table.add(f"{samples:,}", f"{spent:.1f} s", f"{memory:.0f} MB", verdict)
    if keep:
        table.keep()
    return 0


if __name__ == "__main__":
    sys.exit(main())
