"""A model record ↔ the JSON of the topic `model`, with a digest of what it says.

The digest shows damage, not who wrote the text: it is an SHA-256 without a secret. A text without
one, of an older recording or another program, is taken as it is.
"""

from __future__ import annotations

import json
import math
from typing import Any

from ldt_core.base.digest import json_digest
from ldt_core.base.errors import ModelError
from ldt_core.base.experiment import ModelRecord
from ldt_core.recording.messages import quoted

DIGEST = "digest"
METHOD = "sha256:"
MAX_JSON = 100_000_000  # characters, more than a matrix of 2000 x 2000 takes

_KINDS = {"version": int, "kind": str, "trained_on": list, "parameters": dict}
_WORDS = {int: "a whole number", str: "a word", list: "a list", dict: "names with values"}


def model_text(record: ModelRecord) -> str:
    """The JSON of a model.

    Raises:
        ValueError: a number that is not finite.
    """
    data = {
        "version": record.version,
        "kind": record.kind,
        "trained_on": list(record.trained_on),
        "parameters": dict(record.parameters),
    }
    # The digest is of what a reader of the text gets, tuples as lists and names as texts.
    data[DIGEST] = model_digest(json.loads(json.dumps(data, allow_nan=False)))
    return json.dumps(data, allow_nan=False)


def model_digest(content: dict[str, Any]) -> str:
    """`sha256:` and the digest (`json_digest`) of a model without its digest."""
    return METHOD + json_digest({n: value for n, value in content.items() if n != DIGEST})


def parse_model(where: str, text: str) -> ModelRecord:
    """The model in a text.

    Args:
        where: what to call it in messages for people.
        text: of `model_text`, or by the contract's keys alone.

    Raises:
        ModelError: too long, no such JSON, numbers that are not finite, a wrong digest.
    """
    if len(text) > MAX_JSON:
        raise ModelError(where, f"at most {MAX_JSON} characters", len(text))
    try:
        data = json.loads(text, parse_float=_finite, parse_constant=_finite)
    except (ValueError, RecursionError) as error:
        raise ModelError(where, "a model record in JSON", error) from None
    if not isinstance(data, dict):
        raise ModelError(where, "a JSON object", quoted(text))
    for key, kind in _KINDS.items():
        if key not in data:
            raise ModelError(where, f"the key {key!r}", f"only {quoted(sorted(data))}")
        if not isinstance(data[key], kind) or isinstance(data[key], bool):
            raise ModelError(f"{where}, {key}", _WORDS[kind], quoted(data[key]))
    numbers = data["trained_on"]
    if data["version"] < 0:
        raise ModelError(f"{where}, version", "0 or more", data["version"])
    if not all(type(n) is int and n >= 1 for n in numbers):
        raise ModelError(f"{where}, trained_on", "experiment numbers from 1", quoted(numbers))
    _check_digest(where, data)
    return ModelRecord(data["version"], data["kind"], tuple(numbers), data["parameters"])


def _check_digest(where: str, data: dict[str, Any]) -> None:
    if DIGEST not in data:
        return
    try:
        given, right = data[DIGEST], model_digest(data)
    except RecursionError as error:
        raise ModelError(where, "a model record in JSON", error) from None
    if given != right:
        expected = f"{right}, by what the model says (it is damaged, or has been changed)"
        raise ModelError(f"{where}, {DIGEST}", expected, quoted(given))


def _finite(text: str) -> float:
    number = float(text.replace("Infinity", "inf"))
    if not math.isfinite(number):
        raise ValueError(f"{quoted(text)} is no finite number")
    return number
