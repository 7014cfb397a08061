"""Figures of a run, on streams whose answer is known by hand."""

import numpy as np
import pytest

from ldt_core.base.errors import ExperimentError
from ldt_core.base.experiment import (
    FAULTY,
    Action,
    Adaptation,
    Experiment,
    Level,
    Prediction,
    Signal,
    Step,
)
from ldt_core.base.metrics import FreeRunError, Summary
from ldt_core.base.model_state import STATES


def step(number, error, original_error, level, action, version, state="", adequacy=None):
    """One turn of the loop with constant errors [rad/s]."""
    experiment = Experiment(number, 0.0, 0.1, [1.0, 1.0], [5.0, 5.0])
    prediction = Prediction(number, 0.0, 0.1, version, [5.0, 5.0 - error])
    original = Prediction(number, 0.0, 0.1, 0, [5.0 + original_error, 5.0])
    found = prediction.max_error(experiment)
    signal = Signal(number, level, "by hand", version, found, {}, state, adequacy)
    done = Adaptation(number, action, version, "by hand")
    return Step(experiment, prediction, original, signal, done)


def summarised(steps):
    summary = Summary()
    for one in steps:
        summary.add(one)
    return summary


def test_a_run_by_hand():
    """Four experiments: MME is the mean of 1, 2, 4, 1 and that of the original of 1, 2, 4, 8."""
    summary = summarised(
        [
            step(1, 1.0, 1.0, Level.NEGATIVE, Action.KEPT, 0),
            step(2, 2.0, 2.0, Level.WARNING, Action.STORED, 0),
            step(3, 4.0, 4.0, Level.POSITIVE, Action.REFUSED, 0),
            step(4, 1.0, 8.0, Level.POSITIVE, Action.ADAPTED, 1),
        ]
    )
    assert summary.as_dict() == {
        "experiments": 4,
        "mme": 2.0,
        "mme_original": 3.75,
        "left": 2.0 / 3.75,
        "outcome": "Learning helped: the error is 53 % of the original model's "
        "(2.00 of 3.75 rad/s).",
        "learned": "The last new model, at experiment 4: by hand.",
        "states": {**dict.fromkeys(STATES, 0), "not_judged": 4},
        "last_state": "",
        "positives": 2,
        "warnings": 1,
        "negatives": 1,
        "adaptations": 1,
        "refusals": 1,
        "faulty": 0,
        "model_version": 1,
        "rejected": 0,
        "repeated": 0,
        "diagnoses": [],
        "advice": None,
        "notes": [],
    }
    rows = dict(summary.rows())
    assert rows["mean maximum error: twin [rad/s]"] == "2.000"
    assert rows["alarms"] == "2"
    assert rows["new models"] == rows["alarms without a new model"] == "1"
    assert "experiments rejected" not in rows


def test_what_a_faulty_sensor_showed_is_said():
    """ "The model already explains the machine: nothing to learn" of samples that were lost."""
    summary, reason = (
        Summary(),
        "nothing is learned: 20 of 400 samples are 0 rad/s; version 0 stays",
    )
    for number in (1, 2):
        summary.add_signal(Signal(number, Level.NEGATIVE, "adequacy", 0, 199.0, {}, "holds", 1.0))
        summary.add_original(199.0)
        summary.add_adaptation(Adaptation(number, Action.REFUSED, 0, reason, {FAULTY: 1.0}))
    assert summary.outcome == "Nothing is learned from 2 experiments of a faulty sensor."
    assert summary.notes == [f"experiment 1: {reason}"]
    rows = dict(summary.rows())
    assert rows["experiments of a faulty sensor"] == "2"
    assert "alarms without a new model" not in rows


def test_states_are_counted_and_the_last_is_said():
    """In the order of the experiments; one that contradicts its own figure is not judged."""
    given = [("holds", 1.0), ("changed", 9.0), ("holds", 12.0), ("inadequate", 3.0)]
    steps = [
        step(n, 1.0, 2.0, Level.NEGATIVE, Action.KEPT, 0, *known)
        for n, known in enumerate(given, 1)
    ]
    summary = summarised(steps[3:] + steps[:3])
    counted = {name: count for name, count in summary.states.items() if count}
    assert counted == {"holds": 1, "changed": 1, "inadequate": 1, "not_judged": 1}
    rows = dict(summary.rows())
    assert rows["experiments: model holds"] == rows["experiments: not judged"] == "1"
    assert rows["after the last experiment"] == "model inadequate: the best known, not good"
    assert rows["error, in % of the original's"] == "50"
    assert "experiments: learning" not in rows
    assert (summary.cells()["state"], summary.cells()["left %"]) == ("inadequate", "50")


def outcome(errors, action=Action.KEPT, state="holds"):
    """What is said of experiments with these errors of the twin; the original's are 2 rad/s."""
    steps = [
        step(n, error, 2.0, Level.NEGATIVE, action, 0, state, 1.0)
        for n, error in enumerate(errors, 1)
    ]
    return summarised(steps).outcome


def test_a_sound_machine_is_no_failure():
    """The error of the original model is said to be well only where every experiment holds."""
    assert outcome([2.0, 2.0]) == "The model already explains the machine: nothing to learn."
    same = "the error is that of the original model (2.00 rad/s)."
    for state in (*set(STATES) - {"holds"}, ""):
        assert outcome([2.0], state=state) == f"Nothing was learned: {same}"
    for action in (Action.ADAPTED, Action.REFUSED):
        assert outcome([2.0], action, "changed") == f"Learning did not help: {same}"
    assert outcome([2.0], Action.ADAPTED) == f"Learning did not help: {same}"


def test_by_how_much_learning_helped_or_not():
    """In per cent of the original model's error."""
    assert outcome([2.0, 1.0], Action.ADAPTED) == (
        "Learning helped: the error is 75 % of the original model's (1.50 of 2.00 rad/s)."
    )
    assert outcome([2.0, 3.0], Action.ADAPTED) == (
        "Learning made it worse: the error is 125 % of the original model's (2.50 of 2.00 rad/s)."
    )


def test_record_by_record_is_the_same():
    """A recording gives signals, original errors and adaptations each on its own topic."""
    steps = [
        step(1, 1.0, 3.0, Level.NEGATIVE, Action.KEPT, 0),
        step(2, 2.5, 3.0, Level.POSITIVE, Action.ADAPTED, 1),
    ]
    apart = Summary()
    for one in steps:
        apart.add_adaptation(one.adaptation)
    for one in steps:
        apart.add_signal(one.signal)
    for one in steps:
        apart.add_original(one.original.max_error(one.experiment))
    assert apart.as_dict() == summarised(steps).as_dict()


def test_of_nothing_nothing_is_known():
    """A mean over no experiments is None, not 0."""
    assert (Summary().mme, Summary().mme_original, Summary().experiments) == (None, None, 0)
    assert Summary().outcome == ""
    assert ("mean maximum error: original model [rad/s]", "-") in Summary().rows()


def test_rejected_experiments_are_counted_and_the_first_says_why():
    """A thousand bad experiments are one note and a number."""
    summary = Summary()
    for number in (3, 4, 5):
        summary.reject(ExperimentError(f"experiment {number}", "finite samples", "nan"))
    for _ in range(2):
        summary.note("the machine file was older")
    assert summary.rejected == 3
    first = "rejected experiment 3: expected finite samples, got nan"
    assert summary.notes == [first, "the machine file was older"]


def test_errors_of_free_runs_by_hand():
    """RMSE weighs samples, the mean of the maxima weighs experiments."""
    error = FreeRunError()
    error.add(np.array([3.0, -4.0]))
    error.add(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 2.0]))
    expected = {"experiments": 2, "rmse": np.sqrt(29 / 8), "mean_max_error": 3.0}
    assert error.as_dict() == pytest.approx(expected)


@pytest.mark.parametrize(
    ("reason", "said"),
    [
        (
            "since experiment 3: inertia has grown to a factor of 1.2; version 1 has a new cause",
            "Since experiment 3: inertia has grown to a factor of 1.2.",
        ),
        (
            "version 1 learned from experiment 2 and does best in this one",
            "The last new model, at experiment 3: version 1 learned from experiment 2 and does "
            "best in this one.",
        ),
    ],
)
def test_a_summary_says_what_has_changed(reason, said):
    """A run ended with its errors alone: why reality left the model stood in its records."""
    summary = Summary()
    assert summary.learned == ""
    summary.add_adaptation(Adaptation(3, Action.ADAPTED, 1, reason))
    summary.add_adaptation(Adaptation(4, Action.KEPT, 1, "the model explains it; version 1 stays"))
    assert summary.learned == said == summary.as_dict()["learned"]
    summary.add_adaptation(Adaptation(5, Action.ADAPTED, 2, "version 2 estimates its causes anew"))
    last = "The last new model, at experiment 5: version 2 estimates its causes anew."
    assert summary.learned == (f"{said} {last}" if said.startswith("Since") else last)


def test_of_each_cause_the_last_change_is_said():
    """ "Open circuit has gone" stood alone, of a friction that had doubled."""
    summary = Summary()
    for number, change in (
        (3, "inertia has grown to a factor of 1.1"),
        (5, "inertia has grown to a factor of 1.2; open circuit has grown to 0.2"),
        (6, "open circuit has gone"),
    ):
        reason = f"since experiment {number}: {change}; version {number} has a new cause"
        summary.add_adaptation(Adaptation(number, Action.ADAPTED, number, reason))
    assert summary.learned == (
        "Since experiment 5: inertia has grown to a factor of 1.2. "
        "Since experiment 6: open circuit has gone."
    )


def test_what_acts_all_along_is_no_change_and_takes_back_what_was_said():
    """Nor is an amount that is known better, of a change, another change."""
    summary = Summary()
    for number, since, change in (
        (1, "1 or before, unlike the machine file", "input deadzone is 0.9 V"),
        (2, "2", "coulomb friction has grown to 0.2 N m; what else has changed is not known: why"),
        (4, "2 or before, unlike the machine file", "coulomb friction is 0.3 N m"),
        (5, "1 or before, unlike the machine file", "input deadzone has not acted"),
        (6, "1 or before, unlike the machine file", "quadratic drag is 1e-06 N m s^2"),
    ):
        reason = f"since experiment {since}: {change}; version {number} has a new cause"
        summary.add_adaptation(Adaptation(number, Action.ADAPTED, number, reason))
    assert summary.learned == (
        "Since experiment 2: coulomb friction has grown to 0.3 N m. "
        "Since experiment 1 or before, unlike the machine file: quadratic drag is 1e-06 N m s^2."
    )
