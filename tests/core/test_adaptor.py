"""The adaptor stores on a warning, learns on a positive, and refuses what is no better."""

import json

import numpy as np
import pytest
from fake_archive import FakeArchive
from hypothesis import given
from hypothesis import strategies as st

from ldt_core.base.errors import LdtError, OptionError, RecordingError
from ldt_core.base.experiment import Action, Experiment, Level, Prediction, Signal
from ldt_core.detectors.window import Window
from ldt_core.models.base import Model
from ldt_core.twin.adaptor import EARLIER, Adaptor
from ldt_core.twin.gate import Trial
from ldt_core.twin.memory import Memory

LENGTH = 40  # samples of an experiment


class Gain(Model):
    """speed = gain · voltage, by least squares; 1 when untrained."""

    kind = "gain"

    def untrained(self):
        return {"gain": 1.0}

    def build(self):
        self.gain = self.parameters["gain"]

    def predict(self, experiment):
        speed = self.gain * experiment.voltage
        return Prediction(
            experiment.number, experiment.start, experiment.period, self.version, speed
        )

    def fit(self, experiments):
        u = np.concatenate([e.voltage for e in experiments])
        y = np.concatenate([e.speed for e in experiments])
        if not u.any():
            raise LdtError("the voltage is zero throughout")
        return self.successor({"gain": float(u @ y / (u @ u))}, experiments)


class Memoriser(Gain):
    """Knows every sample that it was trained on by heart, and nothing else."""

    kind = "memoriser"

    def untrained(self):
        return {"seen": []}

    def build(self):
        self.seen = dict(self.parameters["seen"])

    def predict(self, experiment):
        speed = [self.seen.get(float(u), 0.9 * float(u)) for u in experiment.voltage]
        if not self.seen:
            speed = experiment.voltage
        return Prediction(
            experiment.number, experiment.start, experiment.period, self.version, speed
        )

    def fit(self, experiments):
        pairs = [[u, y] for e in experiments for u, y in zip(e.voltage, e.speed, strict=True)]
        return self.successor({"seen": pairs}, experiments)


class Stubborn(Gain):
    kind = "stubborn"
    adaptive = False


class Diverging(Gain):
    kind = "diverging"

    def predict(self, experiment):
        speed = np.full(len(experiment), np.inf if self.version else 0.0)
        return Prediction(
            experiment.number, experiment.start, experiment.period, self.version, speed
        )


class Singular(Gain):
    kind = "singular"

    def fit(self, experiments):
        raise np.linalg.LinAlgError("Singular matrix")


def experiment(number, gain, noise=0.01, length=LENGTH):
    """A machine whose speed is its gain times the voltage, measured with noise."""
    rng = np.random.default_rng(number)
    voltage = rng.uniform(-1, 1, length)
    speed = gain * voltage + noise * rng.standard_normal(length)
    return Experiment(number, float(number), 0.1, voltage, speed)


def signal(number, level):
    return Signal(number, level, "by hand", 0, 0.0)


def run(adaptor, plan, gain=2.0):
    """Steps through levels: "-" negative, "0" warning, "+" positive."""
    levels = {"-": Level.NEGATIVE, "0": Level.WARNING, "+": Level.POSITIVE}
    return [
        adaptor.step(experiment(i, gain), signal(i, levels[sign]))
        for i, sign in enumerate(plan, start=1)
    ]


def actions(steps):
    return [adaptation.action.value for adaptation, _ in steps]


def test_the_paper_s_rules():
    """Negative does nothing, warning stores, positive learns from S_w and the present one."""
    adaptor = Adaptor(Gain(None), Memory(), gate="none", data="warning-set")
    steps = run(adaptor, "-0-0+-")
    assert actions(steps) == ["kept", "stored", "kept", "stored", "adapted", "kept"]
    assert [len(steps[i][1].trained_on) for i in (3, 4)] == [0, 3]
    assert steps[4][1].trained_on == (2, 4, 5)
    assert [adaptation.model_version for adaptation, _ in steps] == [0, 0, 0, 0, 1, 1]
    assert [adaptation.details["warning_set"] for adaptation, _ in steps] == [0, 1, 1, 2, 0, 0]
    assert len(adaptor.memory) == 0, "S_w is reset after the adaptation"


@pytest.mark.parametrize(
    ("state", "adequacy", "words"),
    [
        ("holds", 1.02, "the model explains it; version"),
        ("inadequate", 14.2, "the best model known does not explain it; version"),
        ("changed", 3.0, "the model does not explain it any more"),
        ("", None, "whether the model explains it is not judged; version"),
        ("holds", 1200.0, "is not judged; version"),
    ],
)
def test_what_is_kept_assures_of_nothing_that_is_not_known(state, adequacy, words):
    """A negative of the paper's detectors stands beside any state: the reason says which."""
    told = Signal(1, Level.NEGATIVE, "by hand", 0, 0.0, {}, state, adequacy)
    done, _ = Adaptor(Gain(None), Memory()).step(experiment(1, 2.0), told)
    assert (done.action, done.model_version) == (Action.KEPT, 0)
    assert words in done.reason
    assert done.reason.endswith("; version 0 stays")
    assert "no drift" not in done.reason


def test_the_drifted_gain_is_learned_through_the_gate():
    """The machine's gain doubles; the adopted model has it to within the noise."""
    adaptation, model = run(Adaptor(Gain(None), Memory()), "00+")[-1]
    assert model.gain == pytest.approx(2.0, abs=0.01)
    assert adaptation.action is Action.ADAPTED
    assert adaptation.details["candidate_rmse"] == pytest.approx(0.01, rel=0.3)
    assert adaptation.details["present_rmse"] == pytest.approx(np.sqrt(1 / 3), rel=0.2)
    assert "version 1" in adaptation.reason
    assert "3 experiments" in adaptation.reason


def test_the_final_model_learns_from_everything():
    """Nothing is held back from the model that is adopted."""
    pool = [experiment(i, 2.0) for i in (1, 2, 3)]
    _, model = run(Adaptor(Gain(None), Memory()), "00+")[-1]
    assert model.gain == Gain(None).fit(pool).gain


def test_a_model_that_learned_by_heart_is_refused():
    """Zero error on its own training data, worse than the present model on what was held back."""
    pool = [experiment(1, 1.0)]
    untrained = Memoriser(None)
    assert untrained.fit(pool).predict(pool[0]).max_error(pool[0]) == 0.0
    adaptation, model = run(Adaptor(untrained, Memory()), "+", gain=1.0)[-1]
    assert adaptation.action is Action.REFUSED
    assert model is untrained
    assert adaptation.details["candidate_rmse"] > adaptation.details["present_rmse"]
    figures = [f"{adaptation.details[key]:.4g}" for key in ("candidate_rmse", "present_rmse")]
    assert all(figure in adaptation.reason for figure in figures), adaptation.reason


def test_without_a_gate_it_is_taken():
    """As in the paper."""
    adaptor = Adaptor(Memoriser(None), Memory(), gate="none")
    assert actions(run(adaptor, "+", gain=1.0)) == ["adapted"]


def test_a_model_that_is_worse_empties_the_warning_set_all_the_same():
    """The machine goes on wearing: what was stored does not describe it for ever."""
    adaptor = Adaptor(Memoriser(None), Memory(), holdout=0.5, data="warning-set")
    steps = run(adaptor, "0+0+", gain=1.0)
    assert actions(steps) == ["stored", "refused", "stored", "refused"]
    assert [adaptation.details["experiments"] for adaptation, _ in steps[1::2]] == [2, 2]
    assert len(adaptor.memory) == 0


def test_a_training_that_failed_keeps_its_experiments_for_the_next():
    """Nothing speaks against the data but that there were too few of them."""
    still = Experiment(1, 0.0, 0.1, np.zeros(LENGTH), np.zeros(LENGTH))
    adaptor = Adaptor(Gain(None), Memory(), data="warning-set")
    adaptor.step(still, signal(1, Level.POSITIVE))
    assert [e.number for e in adaptor.memory.experiments] == [1]
    adaptation, model = adaptor.step(experiment(2, 2.0), signal(2, Level.POSITIVE))
    assert adaptation.action is Action.ADAPTED
    assert model.trained_on == (1, 2)


@pytest.mark.parametrize(
    ("model", "gate", "words"),
    [
        (Stubborn, "holdout", "a stubborn model does not learn"),
        (Stubborn, "none", "a stubborn model does not learn"),
        (Diverging, "holdout", "finite"),
        (Singular, "holdout", "Singular matrix"),
        (Singular, "none", "Singular matrix"),
    ],
)
def test_a_training_that_fails_is_refused_and_the_loop_goes_on(model, gate, words):
    """The reason says why; the present model stays."""
    adaptor = Adaptor(model(None), Memory(), gate=gate)
    steps = run(adaptor, "+-")
    assert actions(steps) == ["refused", "kept"]
    assert words in steps[0][0].reason
    assert "version 0 stays" in steps[0][0].reason
    assert steps[1][1].version == 0


def test_unexcited_data_are_refused_with_the_model_s_own_reason():
    """A constant zero voltage tells a gain nothing."""
    still = Experiment(1, 0.0, 0.1, np.zeros(LENGTH), np.ones(LENGTH))
    adaptation, _ = Adaptor(Gain(None), Memory()).step(still, signal(1, Level.POSITIVE))
    assert adaptation.action is Action.REFUSED
    assert "voltage is zero" in adaptation.reason


def test_too_short_an_experiment_is_refused():
    """Four blocks of at least two samples need eight."""
    short = experiment(1, 2.0, length=7)
    adaptation, _ = Adaptor(Gain(None), Memory()).step(short, signal(1, Level.POSITIVE))
    assert adaptation.action is Action.REFUSED
    assert "7 samples" in adaptation.reason


class Spy(Gain):
    """Notes what each training was given."""

    kind = "spy"
    trainings: list = []  # noqa: RUF012

    def fit(self, experiments):
        self.trainings.append([(e.number, e.start, len(e)) for e in experiments])
        return super().fit(experiments)


@given(
    st.integers(1, 9),
    st.sampled_from([0.5, 0.34, 0.25, 0.2, 0.1, 0.05]),
    st.integers(40, 60),
)
def test_what_is_held_back(count, holdout, length):
    """Each training lacks one block of every experiment; each place in time is held back once.

    The number of trainings is the least for which that is so.
    """
    Spy.trainings.clear()
    blocks = round(1 / holdout)
    pool = [experiment(i, 2.0, length=length) for i in range(1, count + 1)]
    trial = Trial(pool, holdout)
    trial.candidate(Spy(None))
    places = set()
    left_out = 0
    for parts in Spy.trainings:
        for e in pool:
            kept = np.zeros(length, dtype=bool)
            for number, start, size in parts:
                if number == e.number:
                    first = round((start - e.start) / e.period)
                    assert not kept[first : first + size].any()
                    kept[first : first + size] = True
            gap = np.flatnonzero(~kept)
            assert np.array_equal(gap, np.arange(gap[0], gap[-1] + 1)), "one block"
            assert length // blocks <= gap.size <= length // blocks + 1
            places.add(round(gap[0] * blocks / length))
            left_out += gap.size
    assert trial.samples == left_out
    assert len(trial.held) == len(Spy.trainings) == -(-blocks // count)
    assert places == set(range(blocks))


def test_the_present_model_is_judged_on_the_same_samples():
    """With one experiment all samples are held back in turn: the present RMSE is the plain one."""
    pool = [experiment(1, 2.0)]
    trial = Trial(pool, 0.25)
    residual = Gain(None).predict(pool[0]).residual(pool[0])
    assert trial.samples == LENGTH
    assert trial.rmse(Gain(None)) == pytest.approx(np.sqrt(np.mean(residual**2)), rel=1e-12)


def test_the_window_detector_trains_on_the_window():
    """Its warnings fill S_w, so that every positive learns from just the last W experiments."""
    detector, adaptor = Window(4), Adaptor(Gain(None), Memory(), "none", data="warning-set")
    trained = []
    for i in range(1, 13):
        now = experiment(i, 2.0)
        detector.update(adaptor.model.predict(now).residual(now))
        adaptation, model = adaptor.step(now, signal(i, detector.signal))
        if adaptation.action is Action.ADAPTED:
            trained.append(model.trained_on)
    assert trained == [(1, 2, 3, 4), (5, 6, 7, 8), (9, 10, 11, 12)]


@pytest.mark.slow
@given(st.text(alphabet="-0+", max_size=12), st.integers(0, 12))
def test_a_restart_changes_nothing(plan, cut):
    """State through JSON in the middle: the same adaptations and models follow."""
    whole = Adaptor(Gain(None), Memory(3, 3))
    parts = Adaptor(Gain(None), Memory(3, 3))
    experiments, models = [], []
    for i, sign in enumerate(plan):
        if i == cut:
            state = json.loads(json.dumps(parts.state()))
            parts = Adaptor(Gain(None), Memory(3, 3))
            records = [Gain.from_record(model.record(), None) for model in models]
            parts.return_to(state, FakeArchive(experiments, records))
        level = signal(i + 1, Level("-0+".index(sign) - 1))
        now = experiment(i + 1, 1.0 + 0.1 * i)
        experiments.append(now)
        one, other = whole.step(now, level), parts.step(now, level)
        assert one[0] == other[0]
        assert one[1].record() == other[1].record()
        models.append(other[1])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [({"gate": "open"}, "gate"), ({"holdout": 0.9}, "0.05 to 0.5"), ({"holdout": "x"}, "number")],
)
def test_bad_arguments_are_named(arguments, words):
    """The sentence names the argument and its range."""
    with pytest.raises(OptionError, match=words):
        Adaptor(Gain(None), Memory(), **arguments)


def step(adaptor, now, sign="+"):
    return adaptor.step(now, signal(now.number, Level("-0+".index(sign) - 1)))


def test_by_evidence_it_learns_from_what_is_still_valid():
    """Of eight recent experiments the four since the gain has changed are learned from, no other.

    Whatever their signals were: the change was noticed late.
    """
    adaptor = Adaptor(Gain(None), Memory())
    for i in range(1, 11):
        step(adaptor, experiment(i, 1.0 if i <= 6 else 2.0), "-")
    adaptation, model = step(adaptor, experiment(11, 2.0))
    assert adaptation.action is Action.ADAPTED
    assert model.trained_on == (7, 8, 9, 10, 11)
    assert adaptation.details["experiments"] == 5


def test_by_evidence_nothing_from_before_an_abrupt_change_is_learned():
    """The warnings in S_w stem from the old machine; the paper would learn from them."""
    trained = {}
    for data in ("evidence", "warning-set"):
        adaptor = Adaptor(Gain(None), Memory(), data=data)
        for i in (1, 2, 3):
            step(adaptor, experiment(i, 1.0), "0")
        trained[data] = step(adaptor, experiment(4, 2.0))[1]
    assert trained["evidence"].trained_on == (4,)
    assert trained["evidence"].gain == pytest.approx(2.0, abs=0.01)
    assert trained["warning-set"].gain < 1.5


def flat(number, level, gain):
    """An experiment that stands still at one voltage, but for a ripple."""
    voltage = level + 0.01 * np.sin(np.arange(LENGTH))
    speed = gain * voltage + 0.01 * np.random.default_rng(number).standard_normal(LENGTH)
    return Experiment(number, float(number), 0.1, voltage, speed)


def test_an_experiment_that_stood_still_is_not_learned_from_alone():
    """The last ones that cover the usual range join it."""
    adaptor = Adaptor(Gain(None), Memory())
    for i in (1, 2, 3):
        step(adaptor, experiment(i, 2.0), "-")
    _, model = step(adaptor, flat(4, 0.5, 2.0))
    assert model.trained_on == (1, 2, 3, 4)


def test_a_repaired_machine_gets_its_first_model_back():
    """The untrained model is exact for the machine as it was; no training can be better."""
    adaptor = Adaptor(Gain(None), Memory())
    _, worn = step(adaptor, experiment(1, 2.0))
    adaptation, repaired = step(adaptor, experiment(2, 1.0))
    assert adaptation.action is Action.ADAPTED
    assert (repaired.version, repaired.gain) == (2, 1.0)
    assert "version 2 is version 0 again" in adaptation.reason
    _, again = step(adaptor, experiment(3, 2.0))
    assert again.gain == pytest.approx(worn.gain, abs=0.01)


def test_an_earlier_model_that_is_the_present_one_is_not_compared_with_it_in_figures():
    """The error is said once: two equal figures would look like a slip."""
    adaptor = Adaptor(Gain(None), Memory())
    step(adaptor, experiment(1, 2.0))
    step(adaptor, experiment(2, 1.0))
    adaptation, _ = step(adaptor, experiment(3, 1.0))
    assert adaptation.action is Action.REFUSED
    assert adaptation.reason.startswith("no better on data held back: the same RMSE, ")
    assert " against " not in adaptation.reason


def test_the_models_that_may_come_back_are_few_and_the_first_is_among_them():
    """However often it adapts."""
    adaptor = Adaptor(Gain(None), Memory())
    for i in range(1, 30):
        step(adaptor, experiment(i, 1.0 + i))
    assert len(adaptor.earlier) == EARLIER + 1
    assert adaptor.earlier[0].version == 0


@pytest.mark.parametrize("state", [{}, {"memory": {}, "earlier": []}, {"earlier": [{"x": 1}]}, 3])
def test_a_foreign_state_is_refused(state):
    """And the adaptor goes on as it was."""
    adaptor = Adaptor(Gain(None), Memory())
    step(adaptor, experiment(1, 2.0), "0")
    before = adaptor.state()
    with pytest.raises((KeyError, TypeError, RecordingError)):
        adaptor.return_to(state, FakeArchive())
    assert adaptor.state() == before
