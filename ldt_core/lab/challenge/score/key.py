"""The keys of a challenge: what was true, read only when all answers are written down."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ldt_core.base.bounded_file import read_bounded
from ldt_core.base.errors import BadInput, did_you_mean
from ldt_core.effects import EFFECTS
from ldt_core.lab.challenge.case_plan import KINDS, MEMBERS

MOST_BYTES = 100_000_000  # of a key that is read: no challenge comes near
ABOUT = ("physics", "current_noise", "file")  # of the setting, for checks and tables
BEFOREHAND = ("case", "left_out")  # what of an entry may be read before the case is diagnosed


@dataclass(frozen=True)
class Truth:
    """A key's entry.

    Attributes:
        case: name of its folder.
        kind: none, single, pair, triple or outside; left_out for a single effect that the diagnosis
            has to do without.
        effects: that act; none of an outside case.
        outside: name of what acts in an outside case.
        parameters: effect to parameter to {value, unit}; a value may be None.
        place: where it acts if only in a region: quantity, from, to, unit, either_sign.
        noise: deviation on the speed [rad/s]; None if the key does not say.
        signal_to_noise: root mean square of the gap over the noise; None if the key does not say.
        left_out: effect that the diagnosis has to do without.
        further_noise: root mean square of the noise as it fell out, by number of the further
            experiment [rad/s]; empty if the key does not say.
        about: see ABOUT, as far as the key says them.
    """

    case: str
    kind: str
    effects: tuple[str, ...] = ()
    outside: str | None = None
    parameters: Mapping[str, Mapping[str, Any]] | None = None
    place: Mapping[str, Any] | None = None
    noise: float | None = None
    signal_to_noise: float | None = None
    left_out: str | None = None
    further_noise: Mapping[int, float] = field(default_factory=dict)
    about: Mapping[str, Any] | None = None

    @property
    def name(self) -> str:
        """What acts, in words."""
        return " + ".join(self.effects) or self.outside or "none"


def sha256(file: str | Path) -> str:
    """Of a key's bytes.

    Raises:
        BadInput: the file cannot be read.
    """
    return hashlib.sha256(_bytes(file)).hexdigest()


def left_out(files: Sequence[str | Path]) -> dict[str, str | None]:
    """Case to the effect that its diagnosis has to do without; the rest is dropped unseen.

    Raises:
        BadInput: a file that is no key, a case that two entries name, an unknown effect.
    """

    def kept(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        return {name: value for name, value in pairs if name in BEFOREHAND}

    found: dict[str, str | None] = {}
    for file in files:
        for where, entry in _entries(file, kept):
            if entry["case"] in found:
                raise BadInput(where, "one entry for each case", f"{entry['case']} again")
            name = entry.get("left_out")
            if name is not None:
                _known(f"{where}, left_out", [name])
            found[entry["case"]] = name
    if not found:
        raise BadInput(", ".join(map(str, files)), "entries of cases", "none")
    return found


def read_keys(files: Sequence[str | Path]) -> dict[str, Truth]:
    """Case to truth.

    Raises:
        BadInput: a file that is no key, or an entry that cannot be right.
    """
    return {t.case: t for file in files for t in (_truth(*e) for e in _entries(file))}


def _truth(where: str, entry: Mapping[str, Any]) -> Truth:
    where, kind = f"{where}, {entry['case']}", entry.get("kind")
    if kind not in KINDS:
        raise BadInput(f"{where}, kind", f"one of {', '.join(KINDS)}", repr(kind))
    names = entry.get("effects") or []
    if not isinstance(names, list) or not all(isinstance(n, str) for n in names):
        raise BadInput(f"{where}, effects", "a list of names", repr(names))
    wanted = 0 if kind == "outside" else MEMBERS[kind]
    if len(set(names)) != wanted:
        raise BadInput(f"{where}, effects", f"{wanted} of a {kind} case", len(names))
    _known(f"{where}, effects", names)
    left, numbers = entry.get("left_out"), {}
    for name in ("noise", "signal_to_noise"):
        value = entry.get(name)
        if value is not None and not (_is_number(value) and value >= 0):
            raise BadInput(f"{where}, {name}", "a number of 0 or more", repr(value))
        numbers[name] = value
    return Truth(
        case=entry["case"],
        kind="left_out" if left is not None else kind,
        effects=tuple(sorted(names)),
        outside=entry.get("outside"),
        parameters=_parameters(where, entry.get("parameters") or {}),
        place=_place(where, entry.get("place")),
        left_out=left,
        further_noise=_further_noise(where, entry.get("further_noise") or {}),
        about={n: entry[n] for n in ABOUT if n in entry},
        **numbers,
    )


def _parameters(where: str, given: Any) -> Mapping[str, Mapping[str, Any]]:
    values = given.values() if isinstance(given, Mapping) else [None]
    if not all(isinstance(v, Mapping) for v in values):
        raise BadInput(f"{where}, parameters", "effects with parameters", type(given).__name__)
    for name, own in given.items():
        for parameter, amount in own.items():
            value = amount.get("value") if isinstance(amount, Mapping) else amount
            if not isinstance(amount, Mapping) or not (value is None or _is_number(value)):
                at = f"{where}, {name}, {parameter}"
                raise BadInput(at, "a value with unit, or null", repr(amount))
    return given


def _place(where: str, given: Any) -> Mapping[str, Any] | None:
    if given is None:
        return None
    ends = [given.get("from"), given.get("to")] if isinstance(given, Mapping) else ["?"]
    if not all(e is None or _is_number(e) for e in ends) or "quantity" not in given:
        raise BadInput(f"{where}, place", "a quantity with from and to", repr(given))
    return given


def _further_noise(where: str, given: Any) -> Mapping[int, float]:
    if not isinstance(given, Mapping) or not all(
        n.isdecimal() and _is_number(v) and v >= 0 for n, v in given.items()
    ):
        at = f"{where}, further_noise"
        raise BadInput(at, "numbers of experiments with numbers of 0 or more", repr(given))
    return {int(n): float(v) for n, v in given.items()}


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _known(where: str, names: Sequence[Any]) -> None:
    known = EFFECTS.names()
    for name in names:
        if name not in known:
            raise BadInput(where, did_you_mean(str(name), known), repr(name))


def _bytes(file: str | Path) -> bytes:
    try:
        return read_bounded(file, MOST_BYTES)
    except OSError as error:
        raise BadInput(file, "a readable key", error.strerror or error) from error


def _entries(
    file: str | Path, kept: Callable[[list[tuple[str, Any]]], dict[str, Any]] = dict
) -> list[tuple[str, dict[str, Any]]]:
    try:
        found = json.loads(_bytes(file).decode(), object_pairs_hook=kept)
    except BadInput:
        raise
    except (ValueError, RecursionError) as error:
        raise BadInput(file, "a key, which is JSON", "something else") from error
    for entry in found if isinstance(found, list) else [None]:
        if not isinstance(entry, dict) or not isinstance(entry.get("case"), str):
            raise BadInput(file, "a list of entries, each with its case", "something else")
    return [(str(file), entry) for entry in found]
