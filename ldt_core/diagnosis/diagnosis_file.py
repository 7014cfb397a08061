"""A diagnosis read back from its file: effects to predict with, the experiment to make next."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.errors import BadInput, ExperimentError, did_you_mean
from ldt_core.base.experiment import Experiment
from ldt_core.effects import EFFECTS, get_effect
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.effect import Effect

Array = NDArray[np.float64]

MOST_BYTES = 50_000_000  # of a file that is read: no diagnosis comes near


def read_effects(
    file: str | Path, own: Sequence[Effect] = ()
) -> list[tuple[Effect, dict[str, float]]]:
    """The verdict's effects with their parameters from a `diagnosis.json`.

    A file's text is never run: an effect of the user's own must be given beside it.

    Args:
        file: as `ldt diagnose` wrote it.
        own: effects that are not in the library.

    Raises:
        BadInput: the file cannot be read or is no diagnosis.
        OptionError: an unknown effect, or a parameter outside its bounds.
    """
    found = _read(file)
    given = {e.name: e for e in own}
    acting = []
    for entry in _entries(str(file), found):
        name = entry["effect"]
        known = [*EFFECTS.names(), *given]
        if name not in known:
            raise BadInput(f"{file}, effect", did_you_mean(name, known), repr(name))
        effect = given.get(name) or get_effect(name)
        acting.append((effect, effect.check(entry["parameters"])))
    return acting


def read_next(file: str | Path, machine: Machine) -> tuple[Machine, Array, bool]:
    """The next experiment that a `diagnosis.json` asks for.

    Args:
        file: as `ldt diagnose` wrote it.
        machine: that is to run it.

    Returns:
        The machine with that experiment's length and sample period, (L,) voltage [V], and whether
        the current is to be measured.

    Raises:
        BadInput: the file cannot be read, or asks for no experiment.
        ExperimentError: a voltage outside the machine's limits.
    """
    asked = _read(file).get("next_experiment")
    if asked is None:
        raise BadInput(file, "a next_experiment", "none: nothing is open, or nothing settles it")
    try:
        volts = np.array(asked["voltage"], dtype=np.float64)
        period, channels = float(asked["sample_period"]), [str(c) for c in asked["channels"]]
        blank = Experiment(1, 0.0, period, volts, np.zeros(volts.size))
    except (KeyError, TypeError, ValueError, ExperimentError) as error:
        got = f"something else ({error})"
        raise BadInput(
            f"{file}, next_experiment", "voltage, sample_period, channels", got
        ) from error
    machine.check(blank)
    timed = replace(machine, duration=volts.size * period, sample_period=period)
    return timed, volts, "current" in channels


def _read(file: str | Path) -> Mapping[str, Any]:
    try:
        path = Path(file)
        if path.stat().st_size > MOST_BYTES:
            raise BadInput(file, f"at most {MOST_BYTES} bytes", path.stat().st_size)
        found = json.loads(path.read_text(encoding="utf-8"))
    except BadInput:
        raise
    except (OSError, ValueError, RecursionError) as error:
        got = getattr(error, "strerror", None) or "no JSON"
        raise BadInput(file, "a readable diagnosis.json", got) from error
    if not isinstance(found, Mapping) or not isinstance(found.get("verdict"), Mapping):
        raise BadInput(file, "a diagnosis with the key verdict", "something else")
    return found


def _entries(where: str, found: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Name and parameters of each acting effect; from the candidates if there is no `effects`."""
    listed = found.get("effects")
    try:
        if listed is None:
            names = list(found["verdict"]["effects"])
            if found["verdict"]["kind"] not in ("effect", "ambiguous"):
                names = []
            if found["verdict"]["kind"] == "ambiguous":
                names = names[:1]
            ranked = {c["effect"]: c["parameters"] for c in found.get("candidates", [])}
            listed = [
                {"effect": n, "parameters": {p: a["value"] for p, a in ranked[n].items()}}
                for n in names
            ]
        return [
            {
                "effect": str(e["effect"]),
                "parameters": {str(n): float(v) for n, v in e["parameters"].items()},
            }
            for e in listed
        ]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        got = f"something else ({error})"
        raise BadInput(where, "effects with parameters and numbers", got) from error
