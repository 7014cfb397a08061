"""How one parameter of one effect grows over the experiments of a run.

{kind: staircase, effect: unbalance, parameter: e, from: 0, to: 0.012, steps: 12}

none       nothing changes
staircase  rises in `steps` equal steps, each level held for a random number of experiments (the
           paper's experiment: the first level is `from`, the last `to`)
ramp       rises in every experiment, linearly
abrupt     jumps once from `from` to `to`, in the middle half of the run
repaired   a staircase that is back at `from` for the last part of the run
recurring  jumps to `to` and back to `from`, `steps` times in all (a machine with two products)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ldt_core.base.errors import MachineFileError, OptionError, did_you_mean
from ldt_core.machine.file_values import check_keys, mapping_of, real_number
from ldt_core.machine.machine_file import Machine

KINDS = ("none", "staircase", "ramp", "abrupt", "repaired", "recurring")
KEYS = ("kind", "effect", "parameter", "from", "to", "steps")
STEPS = 10  # of a staircase, unless the file says how many
REPAIR = 0.75  # of the run, after which a `repaired` machine is as new: both states are seen


@dataclass(frozen=True)
class Schedule:
    """The value of one effect's parameter in each experiment.

    Args:
        kind: one of `KINDS`.
        effect, parameter: their names.
        begin, end: first and last (with `repaired`: worst) value, in the parameter's unit.
        steps: changes of a staircase or of `recurring`, if there are enough experiments for all.
        experiments: of the whole run.
        seed: decides when it changes.
    """

    kind: str = "none"
    effect: str = ""
    parameter: str = ""
    begin: float = 0.0
    end: float = 0.0
    steps: int = STEPS
    experiments: int = 1
    seed: int = 0
    #: Value in experiment 1, 2, …
    values: tuple[float, ...] = field(init=False)

    def __post_init__(self) -> None:
        random = np.random.default_rng(np.random.SeedSequence([self.seed, 0]))
        object.__setattr__(self, "values", _values(self, random))

    def value(self, number: int) -> float:
        """The value in experiment `number` (from 1); after the run it stays at the last."""
        return self.values[min(number, self.experiments) - 1]

    @property
    def changes(self) -> list[int]:
        """Numbers of the experiments in which the value is not that of the one before."""
        pairs = zip(self.values, self.values[1:], strict=False)
        return [i + 2 for i, (before, now) in enumerate(pairs) if now != before]


def _values(schedule: Schedule, random: np.random.Generator) -> tuple[float, ...]:
    n, begin = schedule.experiments, schedule.begin
    if schedule.kind == "none" or n == 1:
        return (begin,) * n
    if schedule.kind == "ramp":
        return tuple(np.linspace(begin, schedule.end, n).tolist())
    if schedule.kind == "abrupt":
        first = int(random.integers(max(1, n // 4), max(2, 3 * n // 4 + 1)))
        return (begin,) * first + (schedule.end,) * (n - first)
    worn = max(2, round(REPAIR * n)) if schedule.kind == "repaired" else n
    steps = min(schedule.steps, worn - 1)
    levels = np.linspace(begin, schedule.end, steps + 1)
    if schedule.kind == "recurring":
        levels = np.where(np.arange(steps + 1) % 2, schedule.end, begin)
    return _stairs(levels, worn, random) + (begin,) * (n - worn)


def _stairs(levels: np.ndarray, n: int, random: np.random.Generator) -> tuple[float, ...]:
    """Level after level; every choice of the experiments where it changes is equally likely."""
    changes = np.sort(random.choice(np.arange(1, n), size=levels.size - 1, replace=False))
    return tuple(levels[np.searchsorted(changes, np.arange(n), side="right")].tolist())


def schedule(
    machine: Machine, experiments: int, seed: int, kind: str = "", end: float | None = None
) -> Schedule:
    """The schedule that a machine file asks for in `simulation.degradation`.

    `kind` and `end` are others than the file's, if given.

    Raises:
        MachineFileError: an unknown key, kind, effect or parameter, or a value out of its bounds.
        OptionError: a kind is asked for, and the file does not say what wears.
    """
    where = f"{machine.source}, simulation.degradation"
    given = machine.simulation.get("degradation", {"kind": "none"})
    check_keys(where, mapping_of(where, given), (), KEYS)
    for word in (given.get("kind", "staircase"), kind or "none"):
        if word not in KINDS:
            raise MachineFileError(f"{where}.kind", did_you_mean(str(word), KINDS), repr(word))
    kind = kind or given.get("kind", "staircase")
    if kind == "none":
        return Schedule(experiments=experiments)
    if "effect" not in given:
        raise OptionError(
            f"degradation {kind!r}",
            f"simulation.degradation with effect, parameter and to in {machine.source}",
            "none there",
        )
    for key in ("parameter", "to"):
        if key not in given:
            raise MachineFileError(where, f"the key {key!r}", f"only {sorted(given)}")
    begin = real_number(f"{where}.from", given.get("from", 0.0))
    last = real_number(f"{where}.to", given["to"]) if end is None else end
    steps = given.get("steps", STEPS)
    if isinstance(steps, bool) or not isinstance(steps, int) or steps < 1:
        raise MachineFileError(f"{where}.steps", "a whole number from 1", repr(steps))
    effect, parameter = _checked(machine, where, given, begin, last)
    return Schedule(kind, effect, parameter, begin, last, steps, experiments, seed)


def _checked(
    machine: Machine, where: str, given: Mapping[str, Any], *values: float
) -> tuple[str, str]:
    """(effect, parameter) that exist and take these values."""
    name, parameter = str(given["effect"]), str(given["parameter"])
    for value in values:
        try:
            machine.law(name).check({parameter: value})
        except OptionError as error:
            raise MachineFileError(f"{where}, {error.where}", error.expected, error.got) from None
    return name, parameter
