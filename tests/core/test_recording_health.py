"""The health of a recording: each thing that can be wrong with one, made and found again."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from ldt_core.base.experiment import (
    Action,
    Adaptation,
    Experiment,
    Level,
    ModelRecord,
    Prediction,
    Signal,
)
from ldt_core.doctor.check import Grade
from ldt_core.doctor.recording_checks import findings
from ldt_core.recording.bag import read_bag
from ldt_core.recording.codec import encode
from ldt_core.recording.health import Health
from ldt_core.recording.health import inspect as inspect_bag
from ldt_core.recording.messages import standard
from ldt_core.recording.node_status import node_statuses
from ldt_core.recording.writer import BagWriter

OK, WARNING, PROBLEM = Grade.OK, Grade.WARNING, Grade.PROBLEM
RUN = Path(__file__).resolve().parents[2] / "bags" / "rotor_drift"


def inspect(path: Path, namespace: str = "") -> Health:
    return inspect_bag(read_bag(path, namespace))


def experiment(number: int, start: float = 0.0, length: int = 50) -> Experiment:
    rest = np.zeros(length)
    return Experiment(number, start or 1e9 + 100 * number, 0.01, rest + 10, rest)


def recorded(folder: Path, *messages: object, namespace: str = "") -> Path:
    """A recording of experiments, or of (topic, record or message)."""
    with BagWriter(folder, namespace=namespace, machine="rotor") as writer:
        for index, message in enumerate(messages):
            topic, record = message if isinstance(message, tuple) else ("experiment", message)
            writer.write(topic, record, 1e9 + index)
    return folder


def found(bag: Path, name: str, namespace: str = "") -> list[tuple[Grade, str]]:
    """Grade and sentence of the findings of that name."""
    lines = findings(inspect(bag, namespace))
    for line in lines:
        assert bool(line.remedy) == (line.grade is not OK), line
    return [(f.grade, f.message) for f in lines if f.name == name]


def answers(number: int) -> list[tuple[str, object]]:
    rest = np.zeros(50)
    return [
        ("prediction", Prediction(number, 1e9 + 100 * number, 0.01, 0, rest)),
        ("signal", Signal(number, Level.NEGATIVE, "lddm", 0, 0.1)),
        ("adaptation", Adaptation(number, Action.KEPT, 0, "because")),
    ]


def test_a_run_that_is_whole_has_nothing_but_ok():
    """The recording that ships with LDT; its counts are those of metadata.yaml."""
    lines = findings(inspect(RUN))
    assert {line.grade for line in lines} == {OK}
    told = {line.name: line.message for line in lines}
    assert told["files"].startswith("complete: 1 file, 2.")
    assert "223 messages" in told["files"]
    assert told["experiments"].startswith("40, numbers 1 to 40, 2000 samples at 0.01 s")
    assert "machine rotor, model hybrid (23 versions), detector threshold" in told["settings"]


def test_a_small_recording_has_a_size(tmp_path):
    """Not of 0.0 MB; and one message is not several."""
    rest = np.zeros(50)
    bag = recorded(tmp_path / "bag", Experiment(1, 1e9, 0.01, rest, rest))
    ((_, told),) = found(bag, "files")
    assert re.match(r"complete: 1 file, [1-9]\d* kB, 1 message, ", told)


def test_a_recording_that_was_cut_off_is_a_problem_with_what_is_left(tmp_path):
    """Its recorder was killed: no end; the experiments before it count."""
    bag = tmp_path / "cut"
    shutil.copytree(RUN, bag)
    file = bag / "rotor_drift_0.mcap"
    file.write_bytes(file.read_bytes()[:1_500_000])
    assert found(bag, "files")[0][0] is PROBLEM
    assert "has no end" in found(bag, "files")[0][1]
    ((grade, told),) = found(bag, "metadata")
    assert (grade, "counts 223" in told) == (WARNING, True)
    assert 0 < len(inspect(bag).numbers) < 40


def test_a_damaged_chunk_is_a_problem(tmp_path):
    """Bytes in the middle changed: the checksum tells."""
    bag = tmp_path / "damaged"
    shutil.copytree(RUN, bag)
    file = bag / "rotor_drift_0.mcap"
    data = bytearray(file.read_bytes())
    data[1_000_000:1_000_100] = b"\x00" * 100
    file.write_bytes(data)
    assert any(grade is PROBLEM and "damaged" in told for grade, told in found(bag, "files"))


def test_gaps_repetitions_and_clocks_set_back_are_told(tmp_path):
    """By experiment number; experiments of two lengths as well."""
    start = 1e9 + 1000
    bag = recorded(
        tmp_path / "odd",
        *(experiment(1), experiment(2), experiment(2), experiment(6, start)),
        *(experiment(7, start - 500), experiment(8, start + 900, length=70)),
    )
    told = "; ".join(sentence for _, sentence in found(bag, "experiments"))
    assert "numbers 3 to 5 missing" in told
    assert "number 2 recorded repeatedly" in told
    assert "numbers 2, 7 start before" in told
    assert "of 2 lengths" in told
    assert {grade for grade, _ in found(bag, "experiments")} == {WARNING}


def test_a_number_that_claims_anything_costs_nothing(tmp_path):
    """Experiment two thousand million follows experiment 1: no list of all that is missing."""
    bag = recorded(tmp_path / "far", experiment(1), experiment(2_000_000_000, 1e9 + 200))
    assert inspect(bag).missing == []
    assert found(bag, "experiments") == [(WARNING, "after number 1 comes 2000000000")]


def test_messages_that_are_no_records_are_counted_and_the_first_explained(tmp_path):
    """What every other command would refuse at once; the good ones still count."""
    bad = encode(experiment(2))
    bad.data[10] = np.nan
    bag = recorded(tmp_path / "bad", experiment(1), bad, bad, experiment(3))
    ((grade, told),) = found(bag, "messages")
    assert grade is PROBLEM
    assert told.startswith("/experiment: 2 cannot be used, the first because /experiment")
    assert "finite" in told
    assert sorted(inspect(bag).numbers) == [1, 3]


def test_no_experiments_is_a_problem(tmp_path):
    """A recording of a run's other topics alone."""
    bag = recorded(tmp_path / "none", answers(1)[1])
    assert found(bag, "experiments")[0][0] is PROBLEM


def test_answers_to_experiments_that_are_not_recorded_are_told(tmp_path):
    """Of a recorder that met the machine later than the other nodes: the recording was "ok"."""
    late = [*answers(1), *answers(2), experiment(3), *answers(3)]
    told = found(recorded(tmp_path / "late", *late), "experiments")
    assert told == [(WARNING, "numbers 1, 2 answered, and not recorded")]
    told = found(recorded(tmp_path / "none", *late[:6]), "experiments")
    assert told == [(PROBLEM, "none; numbers 1, 2 answered, and not recorded")]
    assert found(tmp_path / "none", "answers") == []


def test_experiments_without_an_answer_are_told_by_kind(tmp_path):
    """A run that ended in the middle of experiment 2; experiments alone lack nothing."""
    everything = [experiment(1), *answers(1), experiment(2), answers(2)[0]]
    bag = recorded(tmp_path / "half", ("model", ModelRecord(0, "physics", (), {})), *everything)
    sentences = [told for grade, told in found(bag, "answers") if grade is WARNING]
    assert sentences == ["number 2 without signal, adaptation"]
    assert found(recorded(tmp_path / "alone", experiment(1)), "answers") == []


def test_an_experiment_that_came_twice_is_answered_once(tmp_path):
    """Sent again with the same start it is the same; with another start it wants its own."""
    start = 1e9 + 5000
    twice = [experiment(1), *answers(1), experiment(1)]
    assert inspect(recorded(tmp_path / "same", *twice)).unanswered("prediction") == []
    other = [experiment(1), *answers(1), experiment(1, start)]
    assert inspect(recorded(tmp_path / "other", *other)).unanswered("prediction") == [1]
    before = [answers(1)[0], experiment(1), *answers(1)[1:]]  # topics need not keep order
    assert inspect(recorded(tmp_path / "before", *before)).unanswered("prediction") == []


def test_of_many_pauses_the_longest_are_kept_and_all_are_counted(tmp_path):
    """A machine that rests after each experiment: the list does not grow with them."""
    starts, now = [], 1e9
    for number in range(1, 31):
        starts.append(experiment(number, now))
        now += 0.5 + (2 + number % 7) * 0.5
    health = inspect(recorded(tmp_path / "run", *starts))
    assert health.paused == 29
    assert len(health.pauses) == 5
    assert sorted(health.pauses.values()) == [3.5, 4.0, 4.0, 4.0, 4.0]
    assert found(tmp_path / "run", "pauses")[0][1].startswith("29 longer than an experiment, the l")


@pytest.mark.parametrize("namespace", ["", "press"])
def test_what_the_nodes_refused_is_told_with_the_reason(tmp_path, namespace):
    """Counts grow while a run goes on: the last is what counts; another machine's are its own."""
    make = standard()

    def health(name: str, count: int) -> tuple[str, object]:
        pairs = {"rejected experiment: ExperimentError": count, "last rejection": "NaN in it"}
        values = [make.KeyValue(key=k, value=str(v)) for k, v in pairs.items()]
        status = make.DiagnosticStatus(
            level=make.level(1), name=name, message="", hardware_id="", values=values
        )
        stamp = make.Time(sec=1, nanosec=0)
        header = make.Header(stamp=stamp, frame_id="")
        return "/diagnostics", make.DiagnosticArray(header=header, status=[status])

    mine = f"{namespace}/twin".lstrip("/")
    messages = [experiment(1), health(mine, 1), health(mine, 3), health("mill/twin", 9)]
    bag = recorded(tmp_path / "refused", *messages, namespace=namespace)
    ((grade, told),) = found(bag, "rejected", namespace)
    assert grade is WARNING
    assert told == f"{mine} rejected experiment: ExperimentError: 3 (NaN in it)"


def test_a_pause_longer_than_an_experiment_is_told(tmp_path):
    """Experiments take 0.5 s; a pause below that is none, a longer one has its place."""
    starts = {1: 0.0, 2: 0.5, 3: 1.47, 4: 5.0}
    bag = recorded(tmp_path / "run", *(experiment(n, 1e9 + s) for n, s in starts.items()))
    ((grade, told),) = found(bag, "pauses")
    assert (grade, told) == (WARNING, "1 longer than an experiment, 3.03 s before number 4")


def test_a_pause_of_a_day_is_a_plain_number(tmp_path):
    """It was 8.64e+04 s."""
    bag = recorded(tmp_path / "run", experiment(1, 1e9), experiment(2, 1e9 + 86400.7))
    ((_, told),) = found(bag, "pauses")
    assert told == "1 longer than an experiment, 86400 s before number 2"


@pytest.mark.parametrize("count", ["\N{SUPERSCRIPT TWO}", "1" * 5000, "-1", "", "many"])
def test_a_count_that_is_none_counts_nothing(count):
    """A node's values are texts; anybody may publish there."""
    make = standard()
    values = [make.KeyValue(key="rejected experiment: X", value=count)]
    about = {"name": "/press/twin", "message": "", "hardware_id": ""}
    status = make.DiagnosticStatus(level=0, values=values, **about)
    header = make.Header(stamp=make.Time(sec=0, nanosec=0), frame_id="")
    (told,) = node_statuses(make.DiagnosticArray(header=header, status=[status]), "/press/")
    assert (told.role, told.rejected, told.last_rejection) == ("twin", {}, "")
    assert list(node_statuses(make.String(data="no status"), "press")) == []
