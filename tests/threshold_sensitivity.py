"""What each limit of the diagnosis' decision is worth: the table of `ldt docs limits`.

ldt challenge make --cases 60 --seed 60518293 --out cases
python -m tests.threshold_sensitivity --jobs 2 cases cases.key.json

decides each case again with one limit changed at a time, from what the search had found with the
present ones, and keeps the counts in `bags/limits.json`; cases that are kept there already are not
asked again. Without a folder the table alone is written anew.

An amount is halved and doubled; a share or a cosine above a half, its distance from 1.
"""

from __future__ import annotations

import argparse
import functools
import json
import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import Field, fields
from pathlib import Path
from typing import Any
from unittest import mock

from ldt_core.base.result_files import write
from ldt_core.diagnosis import diagnose as whole
from ldt_core.diagnosis.effect_fit import EffectFit
from ldt_core.diagnosis.effect_set_search import EffectSetSearch
from ldt_core.diagnosis.error_band import ErrorBand
from ldt_core.diagnosis.law_departure import LawDepartures, own_laws
from ldt_core.diagnosis.standing import Standing
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.diagnosis.verdict import Decision, decide
from ldt_core.lab.challenge.score.answer import DIAGNOSIS, CaseAnswer
from ldt_core.lab.challenge.score.judge import Judged, outcome
from ldt_core.lab.challenge.score.key import Truth, read_keys
from ldt_core.lab.challenge.score.sealed import cases, read_sealed
from tests.page_table import write_table

KEPT = Path(__file__).parents[1] / "bags" / "limits.json"
#: Limits that do not take part in the decision on a recording's sets.
ELSEWHERE = {
    "trusted_experiments": "asked where a sensor is faulty",
    "start_state_gain": "asked in each fit",
    "prior_deviations": "asked of the file's numbers",
    "told_of_gap": "chooses words",
    "settling_distance": "asked of a further experiment",
}
#: Those by which laws may depart, or effects cancel each other: what is kept of sets depends on it.
OF_LAWS = ("departure_of_law", "law_error", "opposed_responses")
#: Those that are asked on held-out experiments.
OF_STANDING = (
    *("law_error", "least_gap", "remainder_false_alarm", "further_effect_of_gap"),
    *("further_effect_of_remainder", "plainly_structured", "departure_of_law"),
    *("unexplained_of_signal", "behind_reference", "trifle_of_gap", "visible_change"),
)
HEAD = ("| limit | value | why | source | halved | doubled |", "|---|---|---|---|---|---|")
Verdict = tuple[str, list[list[str]]]


def halved_and_doubled(value: float) -> tuple[float, float]:
    """A limit's other values; of a share or cosine above a half, by its distance from 1."""
    if 0.5 < abs(value) < 1:
        near = 1 - abs(value)
        return math.copysign(1 - 2 * near, value), math.copysign(1 - near / 2, value)
    return (value // 2, value * 2) if isinstance(value, int) else (value / 2, value * 2)


@contextmanager
def changed(name: str, value: float) -> Iterator[None]:
    """One limit changed, for this process."""
    before = getattr(THRESHOLDS, name)
    object.__setattr__(THRESHOLDS, name, value)
    try:
        yield
    finally:
        object.__setattr__(THRESHOLDS, name, before)


def told(decision: Decision) -> tuple[Any, ...]:
    """What two decisions have to share to be the same."""
    return decision.kind, decision.best and decision.best.names, decision.acting


class DecidedAgain:
    """A case whose search is done, to be decided again with other limits.

    What a verdict makes the search look for beside a set stays found for the next one.
    """

    def __init__(self, search: EffectSetSearch, about: Sequence[Any], ask: Callable[..., Standing]):
        self.search, self.about, self.ask = search, about, ask
        self.ran = bool(search.found.fits.keys() - {frozenset()})
        self.work = search.residuals.work.steps
        #: Sets whose alternatives were sought.
        self.sought: set[frozenset[str]] = set()
        self.of_laws = False  # whether the last verdict changed a limit of laws

    def verdict(self, limit: str = "") -> Verdict:
        """By the limits as they are now, of which this one is changed."""
        search, found = self.search, self.search.found
        search.residuals.work.steps = self.work
        found.refuted = set()
        if limit in OF_LAWS or self.of_laws:
            found._cancelling = {}
            found._own_laws = own_laws(found.residuals)
            found.departures = LawDepartures(found.residuals, found.base)
        self.of_laws = limit in OF_LAWS
        found.band, search.band = ErrorBand(found.residuals), ErrorBand(search.scout)
        run = (lambda: found) if self.ran else search.run
        machine, fitted, held, seed = self.about
        with mock.patch.multiple(search, run=run, alternatives=self._alternatives):
            decision = decide(search)
            if limit and limit not in OF_STANDING and told(decision) == self.first:
                return self.base
            stands = self.ask(machine, search, decision, fitted, held, seed)
        d, kind = stands.decision, "unknown" if stands.objection else stands.decision.kind
        verdict = kind, d.acting if kind in ("effect", "ambiguous") else []
        if not limit:
            self.first, self.base = told(decision), verdict
        return verdict

    def _alternatives(self, base: EffectFit) -> list[EffectFit]:
        names = frozenset(base.names)
        if names in self.sought:
            return []
        self.sought.add(names)
        return EffectSetSearch.alternatives(self.search, base)


def right(truth: Truth, verdict: Verdict) -> bool:
    """Whether a verdict is what it should be."""
    answer = CaseAnswer(DIAGNOSIS, {"verdict": {"kind": verdict[0], "acting": verdict[1]}})
    return Judged(truth, answer, outcome(truth, answer, None), None, (), None, {}).right


def limits() -> list[Field[Any]]:
    """Those that take part in the decision."""
    return [f for f in fields(THRESHOLDS) if f.name not in ELSEWHERE]


def asked(folder: Path, truth: Truth) -> dict[str, Any]:
    """Whether a case is right as it is, and with each limit halved and doubled."""
    sealed, caught = read_sealed(folder), {}
    ask = whole.standing

    def catch(*given: Any) -> Standing:
        caught["of"] = given
        return ask(*given)

    with mock.patch.object(whole, "standing", catch):
        whole.diagnose(sealed.machine, sealed.shown, seed=0, workers=1)
    machine, search, _, fitted, held, seed = caught["of"]
    again = DecidedAgain(search, (machine, fitted, held, seed), ask)
    for _ in ("to find what each limit asks for", "to decide on all of it"):
        base = again.verdict()
        found: dict[str, Any] = {"right": right(truth, base), "limits": {}}
        for limit in limits():
            both = []
            for value in halved_and_doubled(getattr(THRESHOLDS, limit.name)):
                with changed(limit.name, value):
                    verdict = again.verdict(limit.name)
                both.append([right(truth, verdict), verdict != base])
            found["limits"][limit.name] = both
    return found


def table(kept: dict[str, Any]) -> str:
    """Of all limits, with the answers that get wrong and right when one is changed."""
    known, rows, idle = list(kept["cases"].values()), [], 0
    for limit in fields(THRESHOLDS):
        about, cells = limit.metadata, [ELSEWHERE.get(limit.name, ""), ""]
        if limit.name not in ELSEWHERE:
            cells = [_changes(known, limit.name, k) for k in range(2)]
            idle += cells == ["0", "0"]
        what = f"`{limit.name}` | {getattr(THRESHOLDS, limit.name):g} {about['unit']}"
        rows.append(f"| {what} | {about['reason']} | {about['source']} | {' | '.join(cells)} |")
    sure = sum(c["right"] for c in known)
    first = f"Of {len(known)} cases {sure} are right with the values as they are. "
    first += f"{idle} of {len(limits())} limits can be halved or doubled, and no answer changes."
    return "\n".join([first, "", *HEAD, *rows])


def _changes(known: Sequence[dict[str, Any]], name: str, k: int) -> str:
    now = [(c["right"], *c["limits"][name][k]) for c in known]
    lost = sum(before and not after for before, after, _ in now)
    won = sum(after and not before for before, after, _ in now)
    other = sum(differs for *_, differs in now)
    return f"−{lost} +{won} ({other})" if other else "0"


def main() -> None:
    """Ask the cases, and write the table."""
    parser = argparse.ArgumentParser(description="What each limit of the decision is worth.")
    parser.add_argument("folders", nargs="*", type=Path, help="cases and their key, in turn")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    given = parser.parse_args()
    kept = json.loads(KEPT.read_text("utf-8")) if KEPT.exists() else {"cases": {}}
    tasks = {}
    for folder, key in zip(given.folders[::2], given.folders[1::2], strict=True):
        truths = read_keys([key])
        for name, path in cases(folder).items():
            if f"{folder.name} {name}" not in kept["cases"]:
                tasks[f"{folder.name} {name}"] = functools.partial(asked, path, truths[name])
    with ProcessPoolExecutor(given.jobs) as pool:
        running = {pool.submit(task): name for name, task in tasks.items()}
        for done, one in enumerate(as_completed(running), 1):
            kept["cases"][running[one]] = one.result()
            write(KEPT, json.dumps(kept) + "\n")
            print(f"{done} of {len(tasks)} cases", flush=True)
    write_table("limits", table(kept))


if __name__ == "__main__":
    main()
