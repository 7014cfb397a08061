"""The sealed cases of a folder, as a diagnosis may see them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ldt_core.base.errors import BadInput
from ldt_core.base.experiment import Experiment
from ldt_core.lab.challenge.make import FURTHER, MACHINE, SHOWN
from ldt_core.machine.machine_file import Machine, load_machine
from ldt_core.recording.bag import experiments


@dataclass(frozen=True)
class Sealed:
    """A case without its truth.

    Attributes:
        machine: as its file knows it.
        shown: experiments to diagnose.
        further: of the same machine, for what was promised; may be none.
    """

    machine: Machine
    shown: Sequence[Experiment]
    further: Sequence[Experiment]

    def seen(self) -> dict[str, Any]:
        """What of the case a score needs besides: physics, whether there is current, ranges."""
        ranges: dict[str, Sequence[np.ndarray]] = {
            "speed": [e.speed for e in self.shown],
            "voltage": [e.voltage for e in self.shown],
            "time": [e.time for e in self.shown],
            "experiment": [np.array([float(e.number)]) for e in self.shown],
        }
        return {
            "physics": self.machine.physics,
            "current": all(e.current is not None for e in self.shown),
            "range": {
                quantity: [min(float(v.min()) for v in rows), max(float(v.max()) for v in rows)]
                for quantity, rows in ranges.items()
            },
        }


def cases(folder: str | Path) -> dict[str, Path]:
    """Name to folder of every case, in order.

    Raises:
        BadInput: no cases there, or one that lacks its machine file or recording.
    """
    top, parts = Path(folder), (MACHINE, SHOWN)
    found = {}
    for path in sorted(top.iterdir()) if top.is_dir() else []:
        missing = [name for name in parts if not (path / name).exists()]
        if len(missing) == len(parts):
            continue
        if missing:
            raise BadInput(path, f"a case with {' and '.join(parts)}", f"no {missing[0]}")
        found[path.name] = path
    if not found:
        wanted = f"a folder of cases, each with {', '.join(parts)} and {FURTHER}"
        raise BadInput(folder, wanted, "none" if top.is_dir() else "no folder")
    return found


def read_sealed(folder: Path) -> Sealed:
    """A case from its folder.

    Raises:
        BadInput: a machine file or recording that cannot be read, or that do not fit each other.
    """
    machine = load_machine(folder / MACHINE)
    shown = experiments(folder / SHOWN).experiments
    further = []
    if (folder / FURTHER).exists():
        further = list(experiments(folder / FURTHER).experiments)
    for e in (*shown, *further):
        machine.check(e)
    return Sealed(machine, shown, further)


def check_entries(found: Mapping[str, Any], entries: Mapping[str, Any], folder: str | Path) -> None:
    """Refuse keys that are not those of these cases.

    Raises:
        BadInput: a case without an entry, or an entry without its case.
    """
    for name in found:
        if name not in entries:
            raise BadInput(f"{folder}, {name}", "an entry for it in a key", "none")
    for name in entries:
        if name not in found:
            raise BadInput(f"{folder}, {name}", "the case that a key names", "none")
