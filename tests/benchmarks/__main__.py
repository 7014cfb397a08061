"""All benchmarks, or those named, as one table.

python -m tests.benchmarks [plant linear hybrid …] [--markdown FILE]
"""

from __future__ import annotations

import argparse
import importlib
import os
import platform
import sys
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # before numpy: peers and we get one thread each


def machine() -> str:
    """Processor, cores and Python, as they are here."""
    model = "unknown processor"
    cpu = Path("/proc/cpuinfo")
    if cpu.exists():
        names = [line for line in cpu.read_text().splitlines() if line.startswith("model name")]
        model = names[0].partition(":")[2].strip() if names else model
    return f"{model}, {os.cpu_count()} cores, Python {platform.python_version()}"


def main() -> int:
    """Run, print, and write the table."""
    here = Path(__file__).parent
    names = sorted(p.stem.removeprefix("bench_") for p in here.glob("bench_*.py"))
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", help=f"of {', '.join(names)}; all without")
    parser.add_argument("--markdown", help="write the table to this file as well")
    given = parser.parse_args()
    for name in given.names:
        if name not in names:
            parser.error(f"there is no benchmark {name!r}; there are {', '.join(names)}")
    lines = [
        f"Measured on {machine()}.",
        "",
        "| work | LDT | peer | its time | peer / LDT | aim | note |",
        "|---|---|---|---|---|---|---|",
    ]
    for name in given.names or names:
        print(f"{name} …", file=sys.stderr, flush=True)
        for row in importlib.import_module(f"tests.benchmarks.bench_{name}").run():
            ratio = f"{row.ratio:.3g}" if row.ratio >= 1 else f"1/{1 / row.ratio:.3g}"
            lines.append(
                f"| {row.name} | {_time(row.ours_s)} | {row.peer} | {_time(row.peer_s)} "
                f"| {ratio} | {row.aim} | {row.note} |"
            )
    print("\n".join(lines))
    if given.markdown:
        Path(given.markdown).write_text("\n".join(lines) + "\n")
    return 0


def _time(seconds: float) -> str:
    for scale, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs")):
        if seconds >= scale:
            return f"{seconds / scale:.3g} {unit}"
    return f"{seconds / 1e-9:.3g} ns"


if __name__ == "__main__":
    sys.exit(main())
