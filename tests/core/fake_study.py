"""A study made by hand: plausible rows without a simulation, for whatever only reads a study."""

from __future__ import annotations

import numpy as np
from fake_robust_run import made

from ldt_core.base.experiment import Action, Level
from ldt_core.lab.study.baselines import baseline_cases
from ldt_core.lab.study.drift_detection import drifts_of
from ldt_core.lab.study.facts import Drift, Facts, energy_needed, stream_key
from ldt_core.lab.study.robustness.robust_run import SETUPS
from ldt_core.lab.study.study import Entry, Study
from ldt_core.lab.study.study_case import RunResult, StudyCase

LITERAL = {"gate": "none"}
#: Share of the original's error that a model leaves.
SHARE = {"physics": 1.0, "linear": 0.85, "hybrid": 0.65, "diagnosed": 0.1}
THRESHOLDS = (1.0, 2.0, 4.0, 8.0)


def fake_result(case: StudyCase) -> RunResult:
    """Rows for a case: an error that grows like e squared, fewer of it after adaptations."""
    random = np.random.default_rng([case.seed, len(case.model), len(case.detector)])
    count = case.experiments
    truth = _truth(case, count)
    original = 0.3 + 1.4e5 * truth**2 * random.uniform(0.6, 1.4, count)
    error = 0.3 + (original - 0.3) * SHARE[case.model] * random.uniform(0.7, 1.3, count)
    limit = float(case.resolved["threshold"])
    positive = error > limit
    if case.detector == "window":
        positive = np.arange(1, count + 1) % 10 == 0
    if case.alarms is not None:
        positive = np.isin(np.arange(1, count + 1), case.alarms)
    level = np.where(positive, Level.POSITIVE, np.where(error > limit / 2, 0, Level.NEGATIVE))
    action = [Action.ADAPTED if p else Action.KEPT for p in positive]
    inside = [float(e) / 2 if t > 0.004 else None for e, t in zip(error, truth, strict=True)]
    outside = [float(e) / 2 if t > 0.004 else None for e, t in zip(original, truth, strict=True)]
    return RunResult(
        case=case,
        number=list(range(1, count + 1)),
        truth=truth.tolist(),
        max_error=error.tolist(),
        original=original.tolist(),
        level=[int(v) for v in level],
        action=[str(a) for a in action],
        region_rmse=inside,
        region_rmse_original=outside,
        kept={n: _kept(n, SHARE[case.model]) for n in case.keep},
        seconds=1.5,
    )


def _truth(case: StudyCase, count: int) -> np.ndarray:
    kind = case.settings.get("degradation", "staircase")
    if kind == "none":
        return np.zeros(count)
    if kind == "ramp":
        return np.linspace(0, 0.012, count)
    steps = np.minimum(np.arange(count) * 7 // count, 6) * 0.002
    random = np.random.default_rng(case.seed)
    return np.roll(steps, 0) if case.seed == 0 else np.sort(random.choice(steps, count))


def _kept(number: int, share: float) -> dict[str, list[float]]:
    time = np.arange(400) * 0.05
    voltage = np.repeat(np.random.default_rng(number).uniform(6, 16, 20), 20)
    original = 3 * np.convolve(np.r_[np.zeros(10), voltage], np.ones(11) / 11, mode="valid")
    speed = np.where((original > 28) & (original < 40), 28 + (original - 28) * 0.2, original)
    return {
        "time": time.tolist(),
        "voltage": voltage.tolist(),
        "speed": speed.tolist(),
        "prediction": (speed + share * (original - speed)).tolist(),
        "original": original.tolist(),
    }


def fake_study(
    seeds: int = 3, experiments: int = 70, machine: str = "rotor", notes: tuple[str, ...] = ()
) -> Study:
    """All groups, small."""
    entries: list[Entry] = []

    def add(group: str, model: str, detector: str, **more: object) -> None:
        for seed in range(seeds):
            settings = dict(more)
            keep = (experiments - 2,) if group in ("paper", "better") else ()
            case = StudyCase(model, detector, seed, experiments, machine, settings, keep=keep)
            result = fake_result(case)
            entries.append(Entry(result, (group,)))
            if group in ("paper", "better"):
                beside = [fake_result(c) for c in baseline_cases(result)]
                entries.extend(Entry(b, ("baseline",), (case.key,)) for b in beside)

    for model in ("linear", "hybrid"):
        for detector in ("threshold", "lddm", "window"):
            add("paper", model, detector, **LITERAL)
        for value in THRESHOLDS:
            add("sweep", model, "threshold", **LITERAL, threshold=value)
            add("sweep", model, "lddm", **LITERAL, error_threshold=value)
    for model in ("diagnosed", "hybrid"):
        add("better", model, "adequacy")
    add("better", "linear", "threshold")
    for group, kind in (("kinds", "ramp"), ("control", "none")):
        add(group, "diagnosed", "adequacy", degradation=kind)
        add(group, "hybrid", "threshold", degradation=kind)
    settings = {"seeds": seeds, "experiments": experiments, "machine": machine}
    facts = {stream_key(e.result.case): fake_facts(e.result) for e in entries}
    robust = tuple(made(setup=setup) for setup in SETUPS)
    return Study(settings, tuple(entries), facts, notes=notes, robust=robust)


def fake_facts(result: RunResult) -> Facts:
    """The truth that fits the rows of a fake result."""
    numbers = drifts_of(result.truth)
    drifts = []
    for number in numbers:
        before, after = result.truth[number - 2], result.truth[number - 1]
        energy = 2e16 * (after**2 - before**2) ** 2
        seen = energy > energy_needed(2000)
        drift = Drift(number, number + 4, before, after, energy, 1.0, seen, seen)
        drifts.append(drift)
    floor = [0.35 + 40 * t for t in result.truth]
    late = [f * 3 if n in numbers else f for n, f in enumerate(floor, start=1)]
    rows = (tuple(result.truth), tuple(floor), tuple(late))
    return Facts(result.case.seed, 0.1, *rows, tuple(drifts))
