"""Which runs make up a study."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from ldt_core.base.errors import MachineFileError
from ldt_core.base.settings import preset
from ldt_core.lab.study import GROUPS, NAMED_ONLY
from ldt_core.lab.study.baselines import baseline_cases
from ldt_core.lab.study.study_case import RunResult, StudyCase
from ldt_core.machine.machine_file import load_machine

#: The preset of the paper: model, detector and its thresholds, and all else, which is every row's.
_PRESET = preset("paper")
_THRESHOLD = {name: _PRESET.pop(name) for name in ("threshold", "warning_threshold")}
PAPER = {name: value for name, value in _PRESET.items() if name not in ("model", "detector")}
#: Learn from all that is still valid, and refuse a model that is worse on data held back.
BETTER = {"gate": "holdout", "data": "evidence"}

#: Paper's detector → the parameters of its row in the table. The paper prints no values; they are
#: rad/s, levels in deviations, and experiments.
TABLE: dict[str, dict[str, Any]] = {
    "threshold": _THRESHOLD,
    "lddm": {"error_threshold": 1.0, "drift_level": 3.0, "warning_level": 2.0},
    "window": {"window": 10},
}
PAPER_MODELS = ("linear", "hybrid")
#: That its table fits: 3 found of 9, 3 of 25 positives, and 3 of 44, 0.068, which is printed
#: truncated. With the 12 of our staircase no whole number of hits gives them.
PAPER_DRIFTS = 9
#: Of which the paper says nothing (an order, an offset) or does nothing (a gate).
VARIANTS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("linear", {"order": 2}),
    ("linear", {"offset": True}),
    ("linear", {"gate": "holdout"}),
    ("hybrid", {"gate": "holdout"}),
)
#: rad/s, about geometric; the table's own thresholds are among them.
THRESHOLDS = (0.5, 1.0, 1.75, 3.0, 5.0, 8.0, 12.0, 20.0)
SWEPT = ("threshold", "lddm")
BEYOND = (
    ("linear", "adequacy"),
    ("hybrid", "adequacy"),
    ("diagnosed", "adequacy"),
    ("diagnosed", "threshold"),
)
OTHER_DRIFTS = ("abrupt", "ramp", "recurring", "repaired")
#: Streams without drift a seed: false alarms are rare, and their rate needs many experiments.
CONTROL_STREAMS = 10
FEW_SEEDS = 5  # for the sweep and other kinds of drift, whose figures need fewer

#: Experiments kept for a figure, as parts of the stream: the first, the paper's 92nd of 200, and
#: some in the part where the rotor is worn. Of the first seed alone: 80 kB an experiment.
KEPT = (0.0, 0.46, 0.5, 0.56, 0.62, 0.68, 0.74, 0.8, 0.86, 0.92, 0.98, 1.0)

# What a run costs relative to others, to begin the long ones first: predictions of the diagnosed
# model are free runs of the whole physics; the threshold detector asks for the most trainings.
MODEL_COST = {"linear": 2.0, "hybrid": 1.5, "diagnosed": 8.0}
DETECTOR_COST = {"threshold": 5.0, "window": 2.0}


@dataclass(frozen=True)
class Planned:
    """One run of the plan, see `study.Entry`."""

    case: StudyCase
    groups: tuple[str, ...]
    beside: tuple[str, ...] = ()

    @property
    def order(self) -> tuple[int, float]:
        """Seed by seed, so that streams are simulated once a process; the longest first in each."""
        case = self.case
        alarms = None if case.alarms is None else len(case.alarms) / case.experiments * 8
        cost = DETECTOR_COST.get(case.detector, 1.0) if alarms is None else alarms
        return case.seed, -cost * MODEL_COST.get(case.model, 1.0) * case.experiments


@dataclass(frozen=True)
class StudyPlan:
    """What a study consists of.

    Args:
        seeds: number of streams.
        experiments: of each.
        machine: name or file.
        groups: names in `GROUPS`.
        first_seed: of the seeds, which follow each other.
    """

    seeds: int = 20
    experiments: int = 200
    machine: str = "rotor"
    groups: tuple[str, ...] = tuple(name for name in GROUPS if name not in NAMED_ONLY)
    first_seed: int = 0

    def runs(self) -> list[Planned]:
        """The runs that depend on no other, each once, in the order of groups and seeds."""
        parts = {
            "paper": self._paper(),
            "variants": self._variants(),
            "sweep": self._sweep(),
            "better": self._better(),
            "control": self._control(),
            "kinds": self._kinds(),
        }
        found: dict[str, Planned] = {}
        for group in GROUPS:
            for case in parts.get(group, ()) if group in self.groups else ():
                known = found.get(case.key, Planned(case, ()))
                found[case.key] = replace(known, groups=(*known.groups, group))
        return list(found.values())

    def baselines(self, results: Iterable[tuple[Planned, RunResult]]) -> list[Planned]:
        """The periodic and random runs beside those of the groups paper and better.

        Beside the latter on a few seeds, since a training there takes longer than all else.
        """
        if "baseline" not in self.groups:
            return []
        found: dict[str, Planned] = {}
        for planned, result in results:
            few = planned.case.seed - self.first_seed < FEW_SEEDS
            if "paper" not in planned.groups and not ("better" in planned.groups and few):
                continue
            for case in baseline_cases(result):
                known = found.get(case.key, Planned(case, ("baseline",)))
                found[case.key] = replace(known, beside=(*known.beside, planned.case.key))
        return list(found.values())

    def case(self, model: str, detector: str, index: int, settings: Mapping[str, Any]) -> StudyCase:
        """One case of this study.

        Args:
            model: its name.
            detector: its name.
            index: of the seed, from 0; the first keeps experiments for figures.
            settings: that differ from their defaults.
        """
        seed = self.first_seed + index
        usual = not settings.keys() & {"degradation", "start"}
        keep = self.kept if index == 0 and usual else ()
        if model == "diagnosed":
            settings = {**settings, **self._cause}
        return StudyCase(
            model, detector, seed, self.experiments, self.machine, settings, None, keep
        )

    @property
    def kept(self) -> tuple[int, ...]:
        """Numbers of the experiments that are kept for figures."""
        last = self.experiments
        return tuple(sorted({min(max(1, round(part * last)), last) for part in KEPT}))

    @functools.cached_property
    def _cause(self) -> dict[str, str]:
        """What the diagnosed model is told: the kind of the wear, not its size or when it grows.

        Raises:
            MachineFileError: the file does not say what wears.
        """
        if "effect" not in self._wear:
            where = f"{load_machine(self.machine).source}, simulation.degradation"
            expected = "effect, parameter and to: what wears in a study (ldt docs machine)"
            raise MachineFileError(where, expected, "none")
        return {"cause": self._wear["effect"]}

    @property
    def _wear(self) -> Mapping[str, Any]:
        """What the machine file says of the wear."""
        return load_machine(self.machine).simulation.get("degradation", {})

    def _paper(self) -> Iterable[StudyCase]:
        for index in range(self.seeds):
            for model in PAPER_MODELS:
                for detector, values in TABLE.items():
                    yield self.case(model, detector, index, {**PAPER, **values})

    def _variants(self) -> Iterable[StudyCase]:
        for index in range(min(self.seeds, FEW_SEEDS)):
            for model, other in VARIANTS:
                settings = {**PAPER, **TABLE["threshold"], **other}
                yield self.case(model, "threshold", index, settings)

    def _sweep(self) -> Iterable[StudyCase]:
        for index in range(min(self.seeds, FEW_SEEDS)):
            for model in PAPER_MODELS:
                for detector in SWEPT:
                    for value in THRESHOLDS:
                        values = at_threshold(detector, value)
                        case = self.case(model, detector, index, {**PAPER, **values})
                        yield case if values == TABLE[detector] else replace(case, keep=())

    def _better(self) -> Iterable[StudyCase]:
        for index in range(self.seeds):
            for model, detector in BEYOND:
                yield self.case(model, detector, index, {**BETTER, **TABLE.get(detector, {})})

    def _control(self) -> Iterable[StudyCase]:
        """Nothing drifts, and the model is that of the machine: a positive is a false alarm.

        A machine that its file describes wrongly is none of these: a positive is right there.
        """
        usual = {**BETTER, "degradation": "none"}
        for index in range(self.seeds * CONTROL_STREAMS):
            yield self.case("diagnosed", "adequacy", index, usual)

    def _kinds(self) -> Iterable[StudyCase]:
        learners = (
            ("diagnosed", "adequacy", BETTER),
            ("hybrid", "adequacy", BETTER),
            ("hybrid", "threshold", {**PAPER, **TABLE["threshold"]}),
        )
        for index in range(min(self.seeds, FEW_SEEDS)):
            for model, detector, settings in learners:
                for kind in ("", *OTHER_DRIFTS):  # "" is the machine file's own staircase
                    drift = {"degradation": kind} if kind else {}
                    yield self.case(model, detector, index, {**settings, **drift})
            yield self.case("diagnosed", "adequacy", index, {**BETTER, "start": "random"})


def at_threshold(detector: str, value: float) -> dict[str, Any]:
    """The parameters of a swept detector at a threshold [rad/s]."""
    if detector == "threshold":
        return {"threshold": value, "warning_threshold": value / 2}
    return {**TABLE["lddm"], "error_threshold": value}
