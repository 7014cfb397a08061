"""Sealed cases on disk: folders that tell nothing, and a key apart whose hash is known first.

The order of the cases tells nothing either.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ldt_core.base import result_files
from ldt_core.base.errors import OptionError
from ldt_core.base.experiment import Experiment
from ldt_core.base.parallel import Workers
from ldt_core.lab.challenge.case_plan import CasePlan, plan_case, rounded_numbers
from ldt_core.lab.challenge.laws import LAWS, OUTSIDE
from ldt_core.recording.messages import dump
from ldt_core.recording.writer import BagWriter

#: Shares of the kinds of cases, in percent.
SHARES = {"none": 15, "single": 45, "pair": 15, "triple": 5, "outside": 20}
ORDER, EFFECTS, CASE = range(3)  # independent random streams of a challenge


@dataclass(frozen=True)
class Order:
    """A case to be made.

    Args:
        name: of its folder.
        kind: none, single, pair, triple or outside.
        effects: that must act in it; the others of a set are drawn.
        seed: of all that is random in it.
        left_out: effect that the diagnosis is to do without, or None.
        samples: in each experiment.
    """

    name: str
    kind: str
    effects: tuple[str, ...]
    seed: tuple[int, ...]
    left_out: str | None = None
    samples: int = 2000


def case_orders(
    cases: int, seed: int, leave_one_out: bool = False, samples: int = 2000
) -> list[Order]:
    """The cases of a challenge, shuffled.

    Args:
        cases: how many.
        seed: of the challenge.
        leave_one_out: single effects only, each left out of the library by turns.
        samples: in each experiment.
    """
    counts = {"single": cases} if leave_one_out else _counts(cases)
    turns = {kind: _in_turn(kind, seed) for kind in counts}
    wanted = [(kind, next(turns[kind])) for kind, count in counts.items() for _ in range(count)]
    shuffled = np.random.default_rng(np.random.SeedSequence([seed, ORDER])).permutation(cases)
    return [
        Order(
            name=f"case_{number:04d}",
            kind=wanted[index][0],
            effects=wanted[index][1],
            seed=(seed, CASE, number),
            left_out=wanted[index][1][0] if leave_one_out else None,
            samples=samples,
        )
        for number, index in enumerate(shuffled, start=1)
    ]


def _counts(cases: int) -> dict[str, int]:
    """Cases of each kind: the shares, what is left over to the largest remainders."""
    exact = {kind: cases * share / 100 for kind, share in SHARES.items()}
    counts = {kind: int(number) for kind, number in exact.items()}
    behind = sorted(counts, key=lambda kind: counts[kind] - exact[kind])
    for kind in behind[: cases - sum(counts.values())]:
        counts[kind] += 1
    return counts


def _in_turn(kind: str, seed: int) -> Iterator[tuple[str, ...]]:
    """Each effect once in a random order, then once again in another one, and so on."""
    known: Sequence[str] = sorted(OUTSIDE if kind == "outside" else LAWS)
    stream = list(SHARES).index(kind)
    random = np.random.default_rng(np.random.SeedSequence([seed, EFFECTS, stream]))
    while True:
        for name in random.permutation(known):
            yield () if kind == "none" else (str(name),)


MACHINE, SHOWN, FURTHER = "machine.yaml", "recording", "further"
KEY_SUFFIX = ".key.json"

#: What makes the keys of the machine file that goes with a case.
KnownFile = Callable[[CasePlan], Mapping[str, Any]]


def exact_file(plan: CasePlan) -> Mapping[str, Any]:
    """The true machine's own numbers."""
    return plan.machine


Progress = Callable[[Iterator[Any], int, str], Iterable[Any]]


def make_challenge(
    cases: int,
    seed: int,
    out: str | Path,
    key: str | Path = "",
    *,
    leave_one_out: bool = False,
    samples: int = 2000,
    known: KnownFile = exact_file,
    jobs: int = 0,
    say: Callable[[str], None] = lambda digest: None,
    progress: Progress = lambda items, total, doing: items,
) -> Path:
    """Make a challenge; one that is broken off leaves neither cases nor a key.

    Args:
        cases: how many.
        seed: of everything; the same number and seed give the same bytes of the key.
        out: folder to make, with one folder for each case: `machine.yaml`, which the diagnosis may
            know, `recording`, which it diagnoses, and `further` experiments of the same machine,
            which it does not see.
        key: file to write; "" puts it beside the folder, not into it.
        leave_one_out: single effects only, each to be taken from the library by turns.
        samples: in each experiment.
        known: makes the machine files; by default they are exact.
        jobs: processes; 0 takes one for each core.
        say: is told the SHA-256 of the key's bytes before any case is written.
        progress: wraps (items, how many, what is being done).

    Returns:
        the key's file.

    Raises:
        OptionError: a folder or a key that is there already.
        LdtError: a case could not be made, or not written.
    """
    folder, key = check_places(out, key)
    wanted = case_orders(cases, seed, leave_one_out, samples)
    with _emerging(folder, key) as (work, sealed), Workers(jobs) as workers:
        drawn = progress(workers.map(plan_order, wanted), cases, "drawing")
        plans = {order.name: plan for order, plan in drawn}
        text = _key_text([plans[order.name].truth for order in wanted])
        say(hashlib.sha256(text.encode()).hexdigest())
        work.mkdir()
        result_files.write(sealed, text)
        # In the order of their names, whatever was drawn first: times of files tell nothing either.
        items = [(work / order.name, plans[order.name], known) for order in wanted]
        for _ in progress(workers.map(write_case, items), cases, "writing"):
            pass
    return key


@contextmanager
def _emerging(folder: Path, key: Path) -> Iterator[tuple[Path, Path]]:
    """Where to write the cases and the key, which come to their places once both are whole."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        work, sealed = (
            Path(stack.enter_context(TemporaryDirectory(prefix=f".{p.name}-", dir=p.parent)))
            for p in (folder, key)
        )
        yield work / folder.name, sealed / key.name
        check_places(folder, key)
        (sealed / key.name).rename(key)
        (work / folder.name).rename(folder)


def check_places(out: str | Path, key: str | Path = "") -> tuple[Path, Path]:
    """(folder, key file) of a challenge.

    Raises:
        OptionError: one of them is there already, or the key would lie with the cases.
    """
    folder = Path(out)
    key = Path(key) if str(key) else folder.resolve().with_name(folder.resolve().name + KEY_SUFFIX)
    if folder.resolve() in key.resolve().parents:
        raise OptionError("key", f"a file that is not in {folder}, with the cases", key)
    for path, what in ((folder, "out"), (key, "key")):
        if path.exists():
            raise OptionError(what, "a place where nothing is yet", f"{path}, which exists")
    if not key.resolve().parent.is_dir() and key.resolve().parent != folder.resolve().parent:
        raise OptionError("key", "a file in a folder that exists", key)
    return folder, key


def plan_order(order: Order) -> CasePlan:
    """The plan of an ordered case, its name in the key's entry."""
    seed, samples = order.seed, order.samples
    plan = plan_case(order.kind, order.effects, seed=seed, samples=samples)
    truth = {"case": order.name, **plan.truth, "left_out": order.left_out}
    return replace(plan, truth=truth)


def _key_text(truths: Sequence[dict[str, Any]]) -> str:
    """The key as JSON, one case a line so that two keys can be compared."""
    lines = ",\n".join(json.dumps(t, sort_keys=True, allow_nan=False) for t in truths)
    return f"[\n{lines}\n]\n"


def write_case(item: tuple[Path, CasePlan, KnownFile]) -> None:
    """Write the folder of a case."""
    folder, plan, known = item
    folder.mkdir()
    text = dump(rounded_numbers(known(plan)))
    result_files.write(folder / MACHINE, text)
    _write_bag(folder / SHOWN, plan, plan.experiments())
    _write_bag(folder / FURTHER, plan, plan.further())


def _write_bag(path: Path, plan: CasePlan, experiments: Iterable[Experiment]) -> None:
    # Simulated before the file is opened: its chunks tell how long the writer waited.
    whole = list(experiments)
    with BagWriter(path, machine=plan.machine["name"]) as writer:
        for experiment in whole:
            writer.write("experiment", experiment, experiment.end)
