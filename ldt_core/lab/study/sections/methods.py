"""What deviates from the paper, and how each figure is made."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence

from ldt_core.base.sentences import spoken
from ldt_core.lab.study import GROUPS
from ldt_core.lab.study.evidence import Evidence
from ldt_core.lab.study.study import Study
from ldt_core.lab.study.study_case import RunResult
from ldt_core.views.page.blocks import Item, Items, Pairs, Section, Table, Text
from ldt_core.views.page.style import Drawing, pair

DEVIATIONS = (
    (
        "Parameters of the rotor.",
        "The paper prints none. Masses, stiffness and damping are those of Bisoi et al. (2020), "
        "second-hand; the motor's are chosen, as are the noise, the voltage and the staircase.",
    ),
    (
        "LDDM at zero error.",
        "With an error rate of 0 its deviation is 0 too, and “≥” holds with equality: a positive "
        "at zero error. Here no signal is above negative while the error rate is 0, nor before an "
        "earlier experiment has set the registers.",
    ),
    (
        "What f_d is trained on.",
        "The paper does not say. Here the Gaussian process learns the one-step residuals of the "
        "physics with the unmeasured current followed by an observer (innovations), and predicts "
        "in free run.",
    ),
    (
        "The linear model.",
        "In the place of MATLAB's ssest, a continuous-time state space model found by minimising "
        "the error of its free run (output error); its order is chosen on held-out data.",
    ),
    (
        "A drift's five experiments.",
        "The paper's “within the next five experiments” counts the first with the new value; of "
        "several positives for one drift only the first reveals it.",
    ),
    (
        "Thresholds.",
        "The paper prints none but θ_w = θ_c / 2; those used here are listed below.",
    ),
)
METHODS = (
    (
        "Maximum error and MME.",
        "The largest |measured − predicted| speed in an experiment; its mean over all experiments "
        "of a run. Each experiment is predicted, in free run from its first sample, before it can "
        "be learned from.",
    ),
    (
        "Intervals.",
        "A figure is taken per seed, since experiments of one stream are not independent; mean "
        "and 95 % interval over the seeds by Student's t. Comparisons are paired by seed. Counts "
        "of false alarms have exact Poisson intervals.",
    ),
    (
        "Sommerfeld region.",
        "By the steady state V(ω) of the rotor: a band reaches from the lower of the two stable "
        "speeds at the voltage of a fold's minimum to the end of the unstable branch, for the "
        "true e; an experiment's region is where its measured speed is in a band.",
    ),
    (
        "Detectable drift.",
        "The speed with the new value minus that with the old, Δy, under the same voltage; its "
        "energy |Δy|² / σ² is compared with what a χ² test with one false alarm in 1000 finds "
        "with probability 0.9 in one experiment of the drift's five.",
    ),
    (
        "Precision and recall.",
        "Recall: drifts with a positive in their five experiments, over all drifts. Precision: "
        "positives that are the first in a drift's five, over all positives. False alarm rate: "
        "positives outside every drift's five, over experiments outside them.",
    ),
    (
        "Floors.",
        "Maximum error of the true model with the true value of what wears; and the same with the "
        "value of the experiment before, which is the best that learning after the fact can reach.",
    ),
    (
        "Baselines.",
        "Periodic and random alarms train the same model in the same way on the same streams, as "
        "often as the run beside them adapted.",
    ),
)
#: Detector → its parameters that a reader wants to know.
OWN = {
    "threshold": ("threshold", "warning_threshold"),
    "lddm": ("error_threshold", "warning_level", "drift_level"),
    "window": ("window",),
    "calibrated": ("false_alarm_every",),
}


def deviations(evidence: Evidence, drawings: Mapping[str, Drawing | None]) -> Section:
    """Where the paper is silent or cannot be followed."""
    section = Section("deviations", "Deviations from the paper")
    section.blocks.append(Items([Item(text, name) for name, text in DEVIATIONS]))
    rows = [
        [group, pair(*names), _parameters(results)]
        for group in ("paper", "better")
        for names, results in evidence.study.pairs(group).items()
    ]
    if rows:
        head = ("group", "model, detector", "parameters")
        section.blocks.append(Table("Parameters of the detectors", head, rows, cards=True))
    return section


def methods(evidence: Evidence, drawings: Mapping[str, Drawing | None]) -> Section:
    """Formulas in words, and how to do it again."""
    section = Section("methods", "Methods")
    settings = [(name, in_words(value)) for name, value in evidence.study.settings.items()]
    section.blocks += [
        Items([Item(text, name) for name, text in METHODS]),
        Text("To reproduce", "heading"),
        Text(command(evidence.study), "code"),
        Text(
            "The same seeds give the same numbers on one machine; on another processor the last "
            "digits can differ, and with them a decision near a limit."
        ),
        Pairs(settings),
    ]
    return section


def command(study: Study) -> str:
    """The command that makes this study."""
    words = ["ldt", "study"]
    for name in ("seeds", "first_seed", "experiments", "machine"):
        if name in study.settings:
            words += [f"--{name.replace('_', '-')}", str(study.settings[name])]
    groups = study.settings.get("groups", tuple(GROUPS))
    for group in groups if set(groups) != set(GROUPS) else ():
        words += ["--only", str(group)]
    return shlex.join([*words, "--out", "my_study"])


def in_words(value: object) -> str:
    """A setting for people: the members of a list with commas between."""
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)


def _parameters(results: Sequence[RunResult]) -> str:
    case = results[0].case
    resolved = case.resolved
    names = [n for n in OWN.get(case.detector, ()) if resolved[n] >= 0]
    return ", ".join(f"{spoken(name)} {resolved[name]:g}" for name in names) or "–"
