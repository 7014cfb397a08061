"""A run that learns: what it takes from a drift to a model that is right again.

The rotor, 40 experiments of 20 s; between the 10th and the 11th its eccentricity becomes 6 mm. The
peer is what one would put together from libraries, and is told more than the twin: river's ADWIN
over the maximum error, and scikit-learn's ridge regression of the next speed on the last eight
speeds and voltages, of the last three experiments, in free run. Seconds are those of a processor.
"""

from __future__ import annotations

import itertools
import time
from collections import deque
from collections.abc import Iterator

import numpy as np
from river.drift import ADWIN
from sklearn.linear_model import Ridge

from ldt_core.base.experiment import Action, Experiment
from ldt_core.base.settings import resolve
from ldt_core.diagnosis.candidate import Candidate
from ldt_core.diagnosis.effect_fit import fit
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.library import library
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.physics.machine_sizes import most_of
from ldt_core.twin.loop import Twin
from tests.benchmarks.row import Row, load_average

DRIFT, COUNT = 10, 40  # the last experiment before it, and of all
LAGS = 8  # samples
KEPT = 3  # experiments that the peer learns from
SECONDS = 20.0  # of an experiment


def experiments() -> list[Experiment]:
    """As the machine makes them."""
    machine = load_machine("rotor")
    sound, worn = (
        Plant.from_settings(machine, resolve({"seed": 3, "degradation": "none", "effect": given}))
        for given in ([], ["unbalance:e=0.006"])
    )
    return [(sound if n <= DRIFT else worn).experiment(n) for n in range(1, COUNT + 1)]


Dealt = tuple[float, float, bool]  # seconds, maximum error [rad/s], whether a new model came


def ours(stream: list[Experiment]) -> Iterator[Dealt]:
    """The twin with all defaults."""
    twin = Twin("rotor")
    for one in stream:
        begin = time.process_time()
        step = twin.step(one)
        spent = time.process_time() - begin
        yield spent, step.signal.max_error, step.adaptation.action is Action.ADAPTED


def peers(stream: list[Experiment]) -> Iterator[Dealt]:
    """The peer; its first model is of the first experiment."""
    detector, recent = ADWIN(), deque(stream[:1], maxlen=KEPT)
    model = _fitted(recent)
    for one in stream:
        begin = time.process_time()
        error = float(np.abs(one.speed - _free_run(model, one)).max())
        recent.append(one)
        detector.update(error)
        if detector.drift_detected:
            model = _fitted(recent)
        yield time.process_time() - begin, error, detector.drift_detected


def _fitted(recent: deque[Experiment]) -> Ridge:
    rows = [np.hstack([_lagged(e.speed), _lagged(e.voltage)]) for e in recent]
    return Ridge(1e-6).fit(np.vstack(rows), np.concatenate([e.speed[LAGS:] for e in recent]))


def _lagged(values: np.ndarray) -> np.ndarray:
    return np.lib.stride_tricks.sliding_window_view(values[:-1], LAGS)


def _free_run(model: Ridge, one: Experiment) -> np.ndarray:
    speed, known, volts = one.speed.copy(), model.coef_, one.voltage
    for k in range(LAGS, len(speed)):
        past = known[:LAGS] @ speed[k - LAGS : k] + known[LAGS:] @ volts[k - LAGS : k]
        speed[k] = past + model.intercept_
    return speed


def run() -> list[Row]:
    """Measure, after one run that is not counted."""
    stream = experiments()
    list(ours(stream[: DRIFT + 2]))
    mine, other = list(ours(stream)), list(peers(stream))
    total, peer_total = (sum(d[0] for d in all_) for all_ in (mine, other))
    told = f"mean largest error after the drift: LDT {_after(mine)} rad/s, peer {_after(other)}"
    name = "river ADWIN and scikit-learn Ridge (eight lags, three experiments)"
    first, peer_first = (_first(dealt) for dealt in (mine, other))
    return [
        Row("a run that learns, 40 experiments of 20 s", total, name, peer_total, "", told),
        Row(
            "a run that learns, 40 experiments of 20 s",
            *(total, "the machine itself", COUNT * SECONDS, ""),
            f"{total / COUNT * 1e3:.0f} ms of processor time per experiment; {load_average()}",
        ),
        Row(
            "from a drift to the new model, computing time only",
            *(sum(d[0] for d in mine[DRIFT:first]), name),
            *(sum(d[0] for d in other[DRIFT:peer_first]), ""),
            f"LDT in the {_nth(first - DRIFT)} experiment after the drift, "
            f"the peer in the {_nth(peer_first - DRIFT)}",
        ),
        verdict(stream),
    ]


def verdict(stream: list[Experiment]) -> Row:
    """From the drift to a verdict on it, beside a fit of every effect there is."""
    list(_diagnosed(stream[: DRIFT + 1]))  # compiled code is loaded
    spent = 0.0
    for number, seconds, said in _diagnosed(stream):
        spent += seconds if number > DRIFT else 0.0
        if number > DRIFT and said:
            break
    machine, one = load_machine("rotor"), stream[DRIFT]
    most = most_of(machine.parameters, float(np.abs(one.voltage).max()))
    candidates = [Candidate(effect, most) for effect in library(machine)]
    begin = time.process_time()
    bench = FreeRunResiduals(machine, [one], tolerance=THRESHOLDS.law_error)
    for candidate in candidates:
        fit(bench, (candidate,), [candidate.coordinates(candidate.typical)])
    other = time.process_time() - begin
    return Row(
        "from a drift to the verdict, computing time only",
        *(spent, "scipy least_squares, once for each effect", other, ""),
        f"LDT in the {_nth(number - DRIFT)} experiment after the drift, learning included; "
        f"“{said}”; the peer gives no verdict and tries no pairs of {len(candidates)} effects; "
        f"{load_average()}",
    )


def _diagnosed(stream: list[Experiment]) -> Iterator[tuple[int, float, str]]:
    """Number, seconds, and the sentence of a diagnosis, "" without any."""
    twin = Twin("rotor", diagnose=True)
    for one in stream:
        begin = time.process_time()
        step = twin.step(one)
        yield (
            one.number,
            time.process_time() - begin,
            step.diagnosis.sentence.partition(",")[0] if step.diagnosis else "",
        )


def _first(dealt: list[Dealt]) -> int:
    """Experiments up to the first new model behind the drift; all where there is none."""
    changed = itertools.count(DRIFT + 1)
    return next((n for n, d in zip(changed, dealt[DRIFT:], strict=False) if d[2]), COUNT)


def _after(dealt: list[Dealt]) -> str:
    """Mean of the maximum errors behind the drift [rad/s]."""
    return f"{np.mean([d[1] for d in dealt[DRIFT:]]):.2f}"


def _nth(count: int) -> str:
    return {1: "1st", 2: "2nd", 3: "3rd"}.get(count, f"{count}th")
