"""How time and memory of a run grow with the samples of its experiments, as a table.

python -m tests.benchmarks.long_experiments [--keep] [MODEL ...]

Three experiments of the rotor at 100 Hz, the last behind a drift, so that a model is learned. Each
size has a process of its own. Seconds are those of the processor.
"""

from __future__ import annotations

import multiprocessing
import resource
import sys
import time
from dataclasses import replace

from ldt_core.base.settings import resolve
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.runs.offline import run
from tests.benchmarks.measured_table import MeasuredTable

SIZES = (100_000, 300_000, 1_000_000)
MODELS = ("auto", "hybrid", "linear")
COUNT, PERIOD = 3, 0.01  # experiments, s


def measure(model: str, samples: int) -> tuple[float, float, int]:
    """Seconds of the run, memory of its process at most [MB], and models learned."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(_measure, (model, samples))


def _measure(model: str, samples: int) -> tuple[float, float, int]:
    long = replace(load_machine("rotor"), duration=samples * PERIOD)
    given = resolve(
        {"seed": 3, "degradation": "abrupt", "experiments": COUNT, "model": model, "bag": ""}
    )
    plant = Plant.from_settings(long, given)
    made = [plant.experiment(number) for number in range(1, COUNT + 1)]
    begin = time.process_time()
    summary = run(long, given, iter(made), None)
    spent = time.process_time() - begin
    return spent, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3, summary.adaptations


def main() -> int:
    """Measure and print."""
    head = ("model", "samples per experiment", "processor time", "memory", "models learned")
    table = MeasuredTable("samples", "python -m tests.benchmarks.long_experiments", *head)
    keep = "--keep" in sys.argv[1:]
    for model in [name for name in sys.argv[1:] if name != "--keep"] or MODELS:
        for samples in SIZES:
            spent, memory, learned = measure(model, samples)
            table.add(f"`{model}`", f"{samples:,}", f"{spent:.1f} s", f"{memory:.0f} MB", learned)
    if keep:
        table.keep()
    return 0


if __name__ == "__main__":
    sys.exit(main())
