"""Speed as ratios against named peers: `python -m tests.benchmarks`."""
