"""LDDM on whole experiments against river's DDM sample by sample, on the same stream.

River's update is one call per sample, ours one per experiment: that is the difference measured. The
residuals are given; river gets them as the booleans that it wants, prepared outside its time. The
stream has no drift, so that neither starts anew, and both end with the same error rate.
"""

from __future__ import annotations

import importlib

import numpy as np

from ldt_core.detectors.lddm import LDDM
from tests.benchmarks.row import Row, best_of

EXPERIMENTS, SAMPLES = 50, 2000  # 2 s at 1 kHz each, as in the paper's study
REPEATS = 7


def run() -> list[Row]:
    """One row; none without river."""
    try:
        ddm = importlib.import_module("river.drift.binary").DDM
    except ImportError:
        return []
    rng = np.random.default_rng(0)
    stream = rng.normal(0, 0.6, (EXPERIMENTS, SAMPLES))
    limit = 1.0
    bits = (np.abs(stream) > limit).ravel().tolist()
    rates = {}

    def ours() -> None:
        detector = LDDM(error_threshold=limit, drift_level=1000.0)
        for residual in stream:
            detector.update(residual)
        rates["ours"] = detector.statistics["error_rate"]

    def theirs() -> None:
        detector = ddm(drift_threshold=1000.0)
        for wrong in bits:
            detector.update(wrong)
        rates["peer"] = detector._p.get()

    samples = EXPERIMENTS * SAMPLES
    ours_s = best_of(REPEATS, ours) / samples
    peer_s = best_of(REPEATS, theirs) / samples
    difference = abs(rates["ours"] - rates["peer"])
    note = f"{EXPERIMENTS} × {SAMPLES} samples, error rates differ by {difference:.1g}"
    return [Row("LDDM, one sample", ours_s, "river DDM", peer_s, "20×", note)]
