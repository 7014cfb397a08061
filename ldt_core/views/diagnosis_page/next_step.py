"""What to do with a diagnosis: in words, and by which command."""

from __future__ import annotations

from pathlib import Path

import msgs_config
from ldt_core.base.errors import LdtError
from ldt_core.base.printable import as_argument
from ldt_core.base.sentences import listed
from ldt_core.diagnosis.diagnosis import Diagnosis
from ldt_core.diagnosis.recorded_units import FITS
from ldt_core.diagnosis.sentence import sensor_fault
from ldt_core.effects import EFFECTS
from ldt_core.machine.machine_file import load_machine
from ldt_core.views.diagnosis_page.headline import no_effect_needed


def next_step(diagnosis: Diagnosis, kept: Path) -> tuple[str, str]:
    """What to do with the answer, and the command; ("", "") where an experiment comes next.

    Args:
        kept: the file for programs.
    """
    machine = machine_argument(diagnosis)
    recordings = [as_argument(name) for name in diagnosis.recordings] or ["RECORDING"]
    play = f"ldt run --play {recordings[0]} --machine {machine} --out played"
    calibrated = f"ldt calibrate {' '.join(recordings)} --machine {machine}"
    fitted = f"{calibrated} --with {as_argument(str(kept))} --out FILE.yaml"
    if any(FITS in note for note in diagnosis.notes):
        again = f"ldt import TABLE --speed NAME:UNIT ... --out {recordings[0]} --force"
        return "unless the speed's unit and sign are right, import again", again
    if sensor_fault(diagnosis.verdict):
        told = "mend the sensor, or take the experiments that it has not spoiled"
        few = f"ldt diagnose {' '.join(recordings)} --machine {machine} --only NUMBERS"
        return told, f"{few} --out why_sound"
    if diagnosis.verdict.kind == "ambiguous" and diagnosis.next_experiment is None:
        return "as no experiment tells them apart, add the first of them to the file", fitted
    known = _known(diagnosis)
    own = [name for name in diagnosis.verdict.effects if name not in known]
    file = "`own_effects: [FILE.py:NAME]`"
    first = f"write {file} of {listed(own)} into {machine} and " if own else ""
    return {
        "effect": (f"{first}add what was found to the machine file", fitted),
        "unknown": (
            (
                "as the gap differs between experiments, let a twin find what changed, and when",
                f"{play} --diagnose",
            )
            if any(place.quantity == "experiment" for place in diagnosis.where)
            else (
                "let a twin learn what has no name, or add an effect of yours (ldt docs effect)",
                play,
            )
        ),
        "none": ("fit the file's numbers anew", f"{calibrated} --out FILE.yaml")
        if no_effect_needed(diagnosis)
        else ("let the twin watch for changes", play),
    }.get(diagnosis.verdict.kind, ("", ""))


def _known(diagnosis: Diagnosis) -> list[str]:
    """The effects that the machine file may name as it is now."""
    try:
        return load_machine(diagnosis.machine_file).effect_names
    except LdtError:
        return EFFECTS.names()


def machine_argument(diagnosis: Diagnosis) -> str:
    """The machine as a command takes it: a file as it was given, or a shipped one's name."""
    file = Path(diagnosis.machine_file or "FILE")
    shipped = not file.exists() and file.stem in msgs_config.machine_names()
    return as_argument(file.stem if shipped else str(file))
