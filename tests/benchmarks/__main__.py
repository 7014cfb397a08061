"""All benchmarks, or those named, as one table.

python -m tests.benchmarks [plant linear hybrid …] [--keep]
"""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path

from tests.benchmarks.kept import keep, merge, table
from tests.benchmarks.row import Row


def main() -> int:
    """Run, print, and write the table."""
    here = Path(__file__).parent
    names = sorted(p.stem.removeprefix("bench_") for p in here.glob("bench_*.py"))
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", help=f"of {', '.join(names)}; all without")
    parser.add_argument("--keep", action="store_true", help="take them into the page's table")
    given = parser.parse_args()
    for name in given.names:
        if name not in names:
            parser.error(f"there is no benchmark {name!r}; there are {', '.join(names)}")
    measured: list[Row] = []
    for name in given.names or names:
        print(f"{name} …", file=sys.stderr, flush=True)
        measured += importlib.import_module(f"tests.benchmarks.bench_{name}").run()
    print(table(merge([], measured)))
    if given.keep:
        keep(measured)
    return 0


if __name__ == "__main__":
    sys.exit(main())
