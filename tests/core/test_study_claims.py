"""Every claim on hand-made results whose answer is known: for it, against it, and neither."""

from __future__ import annotations

import dataclasses

import pytest
from study_results import made_up

from ldt_core.lab.study import claims as examined
from ldt_core.lab.study.facts import Drift, Facts, stream_key
from ldt_core.lab.study.study import Entry, Evidence, Study

SEEDS = range(6)
ROWS = 40
# Forty experiments; e rises at 11, 21 and 31.
TRUTH = [0.0] * 10 + [1.0] * 10 + [2.0] * 10 + [3.0] * 10
VALUES = (1.0, 2.0, 4.0, 8.0)
SETTING = {"threshold": "threshold", "lddm": "error_threshold"}
SIDES = {"for": 1, "against": -1, "neither": 0}
WORDS = {"for": "confirmed", "against": "not confirmed", "neither": "undecided"}
AIM_WORDS = {"for": "met", "against": "missed", "neither": "undecided"}


def swing(side, seed):
    """About 1, about -1, or one of them in turn; never the same in two seeds."""
    return (side or (-1) ** seed) + 0.01 * seed


def facts(seed, largest=(1.0, 1.0, 1.0), floor=1.0, late=1.2):
    """All drifts can be found, and are twice as large as need be."""
    drifts = tuple(
        Drift(n, n + 4, i, i + 1.0, 1e3, change, True, True)
        for i, (n, change) in enumerate(zip((11, 21, 31), largest, strict=True))
    )
    return Facts(seed, 0.1, tuple(TRUTH), (floor,) * ROWS, (late,) * ROWS, drifts)


def study(side, make, group="paper", truths=None, baseline=None):
    """Runs of both models under all detectors; `make(model, detector, seed, d)` gives the rows."""
    entries, known = [], {}
    for seed in SEEDS:
        d = swing(side, seed)
        for model in ("linear", "hybrid"):
            for detector in ("threshold", "lddm", "window"):
                given = make(model, detector, seed, d)
                run = made_up(TRUTH, model=model, detector=detector, seed=seed, **given)
                entries.append(Entry(run, (group,)))
                if baseline:
                    other = made_up(TRUTH, model=model, detector=baseline, seed=seed, alarms=(1,))
                    case = dataclasses.replace(other.case, settings={"window": len(entries)})
                    other = dataclasses.replace(other, case=case, max_error=[5.0] * ROWS)
                    entries.append(Entry(other, ("baseline",), (run.case.key,)))
        if truths:
            known[stream_key(run.case)] = truths(seed, d)
    return Study({}, tuple(entries), facts=known)


def sweep(side, make):
    """A sweep; `make(model, detector, value, seed, d)` gives the rows."""
    entries = []
    for seed in SEEDS:
        for model in ("linear", "hybrid"):
            for detector, name in SETTING.items():
                for value in VALUES:
                    given = make(model, detector, value, seed, swing(side, seed))
                    given[name] = value
                    run = made_up(TRUTH, model=model, detector=detector, seed=seed, **given)
                    entries.append(Entry(run, ("sweep",)))
    return Study({}, tuple(entries))


def by_level(values):
    return [values[int(e)] for e in TRUTH]


def first(count):
    return list(range(1, round(count) + 1))


def lower_for(model, high=5.0):
    """MME of the model is 5 minus the swing, of the other 5."""
    return lambda m, detector, seed, d: {"max_error": high - d if m == model else high}


def hybrid_count(m, detector, seed, d):
    return {"positives": first(10 - 3 * d if m == "hybrid" else 10)}


def hybrid_precision(m, detector, seed, d):
    if m == "linear":
        return {"positives": [11, 15]}
    return {"positives": [11] if d > 0 else [11, 15, 16]}


def few_detected(m, detector, seed, d):
    return {"positives": [11] if d > 0 else [11, 21]}


def in_region(model, sign):
    return lambda m, detector, seed, d: {
        "region": 0.5 + sign * 0.2 * d if m == model else 0.5,
        "region_original": 1.0,
    }


def growing(m, detector, seed, d):
    rows = by_level([1.0, 2.0, 3.0, 4.0] if d > 0 else [4.0, 3.0, 2.0, 1.0])
    return {"max_error": rows, "original": rows}


def active_lower(m, detector, seed, d):
    return {"max_error": 5.0 if detector == "window" else 5.0 - d, "positives": [11]}


def detecting(m, detector, seed, d):
    return {"positives": [11, 21, 31] if d > 0 else [5, 6, 7]}


def where(m, detector, seed, d):
    region = [None] * 20 + [1.0] * 20
    return {"positives": [25, 26] if d > 0 else [3, 4], "region": region, "region_original": region}


def recall_apart(side):
    def make(m, detector, seed, d):
        if m == "linear" or side > 0:
            return {"positives": [11, 21]}
        return {"positives": [11] if d < 0 else [11, 21, 31]}

    return make


def by_window(side):
    def make(m, detector, seed, d):
        rising = [31, 33, 35, 37, 21]
        if side > 0:
            return {"positives": range(5, 41, 5)}
        return {"positives": rising if side or d > 0 else [41 - n for n in rising]}

    return make


def below_original(model):
    def make(m, detector, seed, d):
        return {"max_error": 6.0 - d if m == model else 6.0, "original": 6.0}

    return make


def swept_mme(m, detector, value, seed, d):
    return {"max_error": 5.0 - d if m == "hybrid" else 5.0, "positives": [11]}


def swept_count(m, detector, value, seed, d):
    return {"positives": first(8 / value if d > 0 else value)}


def swept_linear(side):
    def make(m, detector, value, seed, d):
        return {"max_error": 5.0 if side > 0 else 10.0 + value * (1 if side or d > 0 else -1)}

    return make


def swept_middle(m, detector, value, seed, d):
    ends = value in (VALUES[0], VALUES[-1])
    return {"max_error": 3.0 if ends == (d > 0) else 1.0 + 0.01 * seed}


def swept_turns(m, detector, value, seed, d):
    rows = (1.0, 2.0, 1.0, 2.0) if d > 0 else (1.0, 2.0, 3.0, 4.0)
    return {"max_error": rows[VALUES.index(value)]}


def swept_lddm(m, detector, value, seed, d):
    return {"positives": first(20 if detector == "threshold" else 10 - 5 * d)}


def swept_range(m, detector, value, seed, d):
    width = 10 if detector == "threshold" else 10 - 5 * d
    return {"positives": first(1 + width * (value == VALUES[0]))}


def harmless(side):
    def truths(seed, d):
        return facts(seed, largest=(2.0 + d, 2.0, 2.0))

    return study(side, lambda m, detector, seed, d: {"positives": [11]}, truths=truths)


def with_a_jump(m, detector, seed, d):
    rows = [1.0] * ROWS
    rows[9] = rows[19] = rows[29] = 9.0 + seed
    hit = detector == "window" if d < 0 else detector != "window"
    return {"max_error": rows, "positives": [10, 20, 30] if hit else [7, 17, 27]}


CLAIMS = {
    "hybrid-mme-below-linear": lambda side: study(side, lower_for("hybrid")),
    "hybrid-adapts-less": lambda side: study(side, hybrid_count),
    "linear-below-original": lambda side: study(side, below_original("linear")),
    "hybrid-below-original": lambda side: study(side, below_original("hybrid")),
    "hybrid-precision-higher": lambda side: study(side, hybrid_precision),
    "recall-low": lambda side: study(side, few_detected),
    "recall-equal": lambda side: study(side, recall_apart(side)),
    "missed-drifts-are-harmless": harmless,
    "linear-misses-the-region": lambda side: study(side, in_region("linear", +1)),
    "hybrid-follows-the-region": lambda side: study(side, in_region("hybrid", -1)),
    "hybrid-better-in-the-region": lambda side: study(side, in_region("hybrid", -1)),
    "mme-grows-with-e": lambda side: study(side, growing),
    "every-detector-beats-never": lambda side: study(side, below_original("hybrid")),
    "active-beats-window": lambda side: study(side, active_lower),
    "active-beats-calendar": lambda side: study(side, active_lower, baseline="periodic"),
    "active-beats-chance": lambda side: study(side, active_lower, baseline="random"),
    "recall-above-chance": lambda side: study(side, detecting),
    "precision-above-chance": lambda side: study(side, detecting),
    "quiet-while-e-is-small": lambda side: study(side, where),
    "busy-where-e-is-large": lambda side: study(side, where),
    "active-more-alert": lambda side: study(side, with_a_jump),
    "window-follows-residence": lambda side: study(side, by_window(side)),
    "hybrid-better-at-every-threshold": lambda side: sweep(side, swept_mme),
    "smaller-threshold-adapts-more": lambda side: sweep(side, swept_count),
    "linear-mme-ignores-threshold": lambda side: sweep(side, swept_linear(side)),
    "best-threshold-in-the-middle": lambda side: sweep(side, swept_middle),
    "lddm-mme-fluctuates": lambda side: sweep(side, swept_turns),
    "lddm-adapts-much-less": lambda side: sweep(side, swept_lddm),
    "lddm-adaptations-robust": lambda side: sweep(side, swept_range),
}


def better(side, make, truths=lambda seed, d: facts(seed)):
    """Runs of one learner; `make(seed, d)` gives the rows."""
    entries, known = [], {}
    for seed in SEEDS:
        d = swing(side, seed)
        run = made_up(TRUTH, model="diagnosed", detector="adequacy", seed=seed, **make(seed, d))
        entries.append(Entry(run, ("better",)))
        known[stream_key(run.case)] = truths(seed, d)
    return Study({}, tuple(entries), facts=known)


def found(seed, d):
    return {"positives": [11, 21, 31] if d > 0 else [15, 30]}


AIMS = {
    "near-the-true-model": lambda side: better(side, lambda seed, d: {"max_error": 1.5 - 0.2 * d}),
    "a-tenth-of-the-original": lambda side: better(
        side, lambda seed, d: {"max_error": 1.0 - 0.5 * d, "original": 10.0}
    ),
    "no-needless-adaptations": lambda side: better(
        side, lambda seed, d: {"positives": first(3 - 2 * round(d))}
    ),
    "prompt-detection": lambda side: better(side, found),
    "recall-of-the-detectable": lambda side: better(side, found),
    "precision-of-positives": lambda side: better(side, found),
}


def claims(study):
    return examined.claims(Evidence(study))


def aims(study):
    return examined.aims(Evidence(study))


def one(found, name):
    return next(c for c in found if c.id == name)


@pytest.mark.slow
@pytest.mark.parametrize("name", CLAIMS)
@pytest.mark.parametrize("side", SIDES)
def test_a_claim_is_judged_by_its_interval(name, side):
    """Confirmed, not confirmed or undecided, whatever the figure it stands on."""
    claim = one(examined.CLAIMS, name).examined(Evidence(CLAIMS[name](SIDES[side])))
    assert claim.verdict == WORDS[side], claim.evidence
    assert claim.evidence


@pytest.mark.parametrize("name", AIMS)
@pytest.mark.parametrize("side", SIDES)
def test_an_aim_is_judged_by_its_interval(name, side):
    """Met, missed or undecided."""
    aim = one(aims(AIMS[name](SIDES[side])), name)
    assert aim.verdict == AIM_WORDS[side], aim.evidence


def test_no_claim_is_forgotten():
    """Each of them is in one of the tables above, or has its own test below."""
    nothing = Study({}, ())
    assert {c.id for c in claims(nothing)} == set(CLAIMS)
    assert {a.id for a in aims(nothing)} == {*AIMS, "false-alarms-as-stated"}


def test_without_runs_nothing_is_examined():
    """An empty study, and one with a single model and detector, end in words, not in an error."""
    nothing = Study({}, ())
    assert {c.verdict for c in [*claims(nothing), *aims(nothing)]} == {"not examined"}
    lonely = Study({}, (Entry(made_up(TRUTH, [11], model="hybrid"), ("paper", "better")),))
    assert one(claims(lonely), "hybrid-mme-below-linear").verdict == "not examined"
    assert {c.verdict for c in claims(lonely)} <= {"not examined", "undecided"}
    assert one(aims(lonely), "recall-of-the-detectable").verdict == "not examined"


def test_one_seed_decides_nothing():
    """A single stream has no interval."""
    whole = study(1, lower_for("hybrid"))
    single = Study({}, tuple(e for e in whole.entries if e.result.case.seed == 0))
    assert one(claims(single), "hybrid-mme-below-linear").verdict == "undecided"


def test_the_evidence_has_figures_and_interval():
    """A reader can judge alone."""
    claim = one(claims(study(1, lower_for("hybrid"))), "hybrid-mme-below-linear")
    assert "threshold 0.795 [0.791, 0.799] (3.97 rad/s and 5.00 rad/s)" in claim.evidence
    assert "6 streams" in claim.evidence


def test_one_detector_against_it_is_enough():
    """The hybrid model is better under the threshold detector and worse under LDDM."""

    def make(m, detector, seed, d):
        return {"max_error": 5.0 if m == "linear" else 5.0 - d * (-1) ** (detector == "lddm")}

    claim = one(claims(study(1, make)), "hybrid-mme-below-linear")
    assert claim.verdict == "not confirmed"
    assert ": not confirmed" in claim.evidence
    assert ": confirmed" in claim.evidence


def test_thresholds_at_which_nothing_happens_are_left_out():
    """Where neither model adapts both are the original, and no claim can be about them."""

    def make(m, detector, value, seed, d):
        return {**swept_mme(m, detector, value, seed, d), "positives": [11] if value < 8 else []}

    claim = one(claims(sweep(1, make)), "hybrid-better-at-every-threshold")
    assert claim.verdict == "confirmed"
    assert "Neither model adapted at threshold at 8 rad/s, lddm at 8 rad/s" in claim.evidence


@pytest.mark.parametrize(("alarms", "verdict"), [(2, "met"), (0, "met"), (30, "missed")])
def test_stated_and_observed_false_alarms(alarms, verdict):
    """Stated: one in 10 of 240 experiments without drift, 24; the interval has to hold that."""
    entries = []
    for seed in SEEDS:
        given = {"degradation": "none", "false_alarm_every": 20.0 if alarms < 30 else 100.0}
        run = made_up(
            [0.0] * 40,
            first(alarms if alarms else 2 * (seed < 3)),
            model="diagnosed",
            detector="adequacy",
            seed=seed,
            **given,
        )
        entries.append(Entry(run, ("kinds",)))
    aim = one(aims(Study({}, tuple(entries))), "false-alarms-as-stated")
    assert aim.verdict == verdict, aim.evidence
    assert "in 240 experiments" in aim.evidence


def test_an_aim_that_the_reference_misses_says_so():
    """The true model one experiment late is itself at twice its prompt error."""
    out_of_reach = better(
        1, lambda seed, d: {"max_error": 3.0}, lambda seed, d: facts(seed, late=2.0 + 0.01 * seed)
    )
    name = "near-the-true-model"
    aim = one(aims(out_of_reach), name)
    assert aim.verdict == "missed"
    assert "does not foresee" in aim.evidence
    assert "does not foresee" not in one(aims(AIMS[name](1)), name).evidence
