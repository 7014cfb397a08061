"""A model's text carries a digest of what it says, and is refused where the two do not agree."""

from __future__ import annotations

import json
import math
import string
import subprocess
import sys
from copy import deepcopy

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ldt_core.base.errors import ModelError
from ldt_core.base.experiment import ModelRecord
from ldt_core.recording import model_json as module
from ldt_core.recording.model_json import model_digest, model_text, parse_model

RECORD = ModelRecord(
    3, "linear", (1, 4), {"order": 2, "A": [[0.1, -1e-300], [2.0, 1 / 3]], "b": None}
)
CONTRACT = {"version", "kind", "trained_on", "parameters"}

names = st.text(string.printable, max_size=8)
finite = st.floats(allow_nan=False, allow_infinity=False)
values = st.recursive(
    st.none() | st.booleans() | finite | st.integers() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(names, inner, max_size=4),
    max_leaves=12,
)
records = st.builds(
    ModelRecord,
    version=st.integers(0, 10**6),
    kind=names,
    trained_on=st.lists(st.integers(1, 10**6), max_size=5).map(tuple),
    parameters=st.dictionaries(names, values, max_size=4),
)


@pytest.mark.slow
@given(records)
def test_a_model_comes_back_as_it_was(record):
    """Through the text with its digest, bit for bit."""
    assert parse_model("model", model_text(record)) == record


@given(records, st.data())
def test_whatever_is_changed_in_a_number_is_noticed(record, data):
    """One digit of the text, so that it is still a model."""
    text = model_text(record)
    end = text.index(f'"{module.DIGEST}"')
    places = [i for i in range(end) if text[i].isdigit()]
    at = data.draw(st.sampled_from(places))
    other = data.draw(st.sampled_from([d for d in string.digits if d != text[at]]))
    changed = text[:at] + other + text[at + 1 :]
    try:
        same = json.loads(changed) == json.loads(text)  # 1.0 and 1.00000000000000000001
    except ValueError:
        same = False
    if same:
        assert parse_model("model", changed) == record
    else:
        with pytest.raises(ModelError):
            parse_model("model", changed)


def test_the_contract_s_keys_stay_and_their_order_does_not_count():
    """What others read is where it was; who sorts or indents the text changes nothing."""
    data = json.loads(model_text(RECORD))
    assert set(data) == CONTRACT | {"digest"}
    assert data["parameters"] == RECORD.parameters
    for text in (
        json.dumps(data, sort_keys=True, indent=2),
        json.dumps(dict(reversed(data.items()))),
    ):
        assert parse_model("model", text) == RECORD


def test_a_text_without_a_digest_is_read():
    """As older recordings have it, and programs that know the contract alone."""
    data = json.loads(model_text(RECORD))
    del data["digest"]
    assert parse_model("model", json.dumps(data)) == RECORD


@pytest.mark.parametrize("wrong", ["", "sha256:" + 64 * "0", None, 5, ["sha256"], {"a": 1}])
def test_a_wrong_digest_is_refused_in_a_sentence(wrong):
    """Whatever stands there."""
    data = json.loads(model_text(RECORD))
    data["digest"] = wrong
    with pytest.raises(ModelError, match=r"^bag, digest: expected sha256:[0-9a-f]{64}, by what"):
        parse_model("bag", json.dumps(data))


def test_the_digest_is_the_same_in_another_process():
    """It rests on no order of hashing and no setting of the process."""
    data = json.loads(model_text(RECORD))
    code = (
        "import json, sys; from ldt_core.recording.model_json import model_digest as d; "
        "print(d(json.load(sys.stdin)))"
    )
    other = subprocess.run(
        [sys.executable, "-c", code],
        input=json.dumps(data),
        capture_output=True,
        text=True,
        check=True,
    )
    assert other.stdout.strip() == data["digest"] == model_digest(deepcopy(data))


def test_what_is_too_long_is_refused_unread(monkeypatch):
    """Before any of it is parsed."""
    monkeypatch.setattr(module, "MAX_JSON", 50)
    monkeypatch.setattr(module.json, "loads", lambda *_, **__: pytest.fail("it was parsed"))
    with pytest.raises(ModelError, match="expected at most 50 characters, got 60"):
        parse_model("model", 60 * " ")


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999", "-1e999"])
def test_a_number_that_is_not_finite_is_refused(number):
    """Neither received nor sent."""
    text = f'{{"version": 1, "kind": "a", "trained_on": [], "parameters": {{"x": {number}}}}}'
    with pytest.raises(ModelError, match="is no finite number"):
        parse_model("model", text)
    with pytest.raises(ValueError, match="not JSON compliant"):
        model_text(ModelRecord(1, "a", (), {"x": math.inf}))
