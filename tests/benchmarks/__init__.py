"""Speed as ratios against named peers: `python -m tests.benchmarks`."""

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # before numpy: peers and we get one thread each
