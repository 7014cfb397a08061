"""`ldt export` and `ldt serve`: what other tools get is what was recorded."""

from __future__ import annotations

import asyncio
import csv
import json
import signal
import socket
import struct
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from ldt_core.base.experiment import Experiment
from ldt_core.base.settings import resolve
from ldt_core.cli import invoke, ldt
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.bag import read_bag
from ldt_core.recording.messages import deserialize
from ldt_core.recording.writer import BagWriter
from ldt_core.runs.offline import run
from ldt_core.views.export import sample_table
from ldt_core.views.export.sample_messages import KIND

PATIENCE = 60  # s; a stalled machine is not what is tested


@pytest.fixture(scope="module")
def bag(tmp_path_factory, short_rotor) -> Path:
    """Two experiments with a current, of a twin that does not learn."""
    folder = tmp_path_factory.mktemp("run") / "bag"
    settings = resolve({"model": "physics", "measure_current": True, "experiments": 2})
    machine = load_machine(short_rotor)
    plant = Plant.from_settings(machine, settings)
    run(machine, settings, map(plant.experiment, (1, 2)), folder)
    return folder


def exported(bag: Path, file: Path) -> Path:
    assert invoke(ldt, ["export", str(bag), "-o", str(file)]) == 0
    return file


@pytest.fixture(scope="module")
def measured_runs(bag):
    opened = read_bag(bag)
    predicted = {p.number: p for p in opened.records("prediction")}
    return [(e, predicted[e.number]) for e in opened.experiments()]


def test_a_table_has_every_number_as_it_was(bag, tmp_path, measured_runs):
    """To the last bit; what is not there is an empty cell; units are SI."""
    with exported(bag, tmp_path / "run.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    for name, values in (
        ("speed", [e.speed for e, _ in measured_runs]),
        ("current", [e.current for e, _ in measured_runs]),
        ("predicted_speed", [p.speed for _, p in measured_runs]),
        ("time", [e.start + e.time for e, _ in measured_runs]),
    ):
        np.testing.assert_array_equal([float(r[name]) for r in rows], np.concatenate(values))
    assert {r["experiment"] for r in rows} == {"1", "2"}
    assert {r["predicted_speed_std"] for r in rows} == {""}


def test_parquet_has_the_same_with_types_and_units(bag, tmp_path, measured_runs, monkeypatch):
    """What is not there is null; experiments share groups, whose entries were larger than they."""
    parquet = pytest.importorskip("pyarrow.parquet")
    file = exported(bag, tmp_path / "run.parquet")
    table = parquet.read_table(file)
    assert parquet.ParquetFile(file).num_row_groups == 1
    speed = np.concatenate([e.speed for e, _ in measured_runs])
    np.testing.assert_array_equal(table["speed"].to_numpy(), speed)
    assert table.schema.field("speed").metadata == {b"unit": b"rad/s"}
    assert table["predicted_speed_std"].null_count == len(table)
    assert str(table.schema.field("experiment").type) == "int64"
    monkeypatch.setattr(sample_table, "GROUP_ROWS", 1)
    again = exported(bag, tmp_path / "more.parquet")
    assert parquet.ParquetFile(again).num_row_groups == len(measured_runs)
    assert parquet.read_table(again).equals(table)


def test_mcap_has_every_sample_as_a_message_and_all_that_was_there(bag, tmp_path, measured_runs):
    """In order of their stamps; three joints: measured, predicted, original."""
    found = read_bag(exported(bag, tmp_path / "run.mcap"))
    (e, p), _ = measured_runs
    raws = list(found.messages("joint_states"))
    joints = [deserialize(raw.data, KIND, "samples") for raw in raws[: len(e)]]
    assert joints[0].name == ["rotor", "predicted", "original"]
    np.testing.assert_array_equal([j.velocity[0] for j in joints], e.speed)
    np.testing.assert_array_equal([j.velocity[1] for j in joints], p.speed)
    stamps = [j.header.stamp.sec + j.header.stamp.nanosec / 1e9 for j in joints]
    np.testing.assert_allclose(stamps, e.start + e.time, atol=2e-6)
    assert [raw.time_ns for raw in raws] == sorted(raw.time_ns for raw in raws)
    volts = [deserialize(raw.data, KIND, "samples") for raw in found.messages("voltage")]
    np.testing.assert_array_equal([v.effort[0] for v in volts[: len(e)]], e.voltage)
    original = read_bag(bag)
    for topic in ("experiment", "prediction", "signal", "adaptation", "model"):
        assert [r.data for r in found.messages(topic)] == [r.data for r in original.messages(topic)]


def test_a_file_of_rerun_has_curves(bag, tmp_path):
    """Where the library is installed; else it is said how to get it."""
    if invoke(ldt, ["export", str(bag), "-o", str(tmp_path / "run.rrd")]) == 0:
        assert (tmp_path / "run.rrd").read_bytes()[:3] == b"RRF"
    else:
        assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("out", "words"),
    [("run.xlsx", ".csv, .parquet, .rrd or .mcap"), ("no/run.csv", "a folder that exists")],
)
def test_what_cannot_be_written_is_one_sentence(out, words, bag, tmp_path, monkeypatch, capsys):
    """With exit code 2, and no file."""
    monkeypatch.chdir(tmp_path)
    assert invoke(ldt, ["export", str(bag), "-o", out]) == 2
    assert words in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_recording_is_served_with_its_samples(bag, programs):
    """By the protocol that Foxglove and Lichtblick speak: every topic with schema and CDR bytes."""
    pytest.importorskip("foxglove")
    aiohttp = pytest.importorskip("aiohttp")
    code = "from ldt_core.cli import main; main()"
    options = ("--rate", "2", "--repeat", "--port", "0", "--json")
    process = programs.start(
        [sys.executable, "-c", code, "serve", str(bag), *options],
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    address = json.loads(process.stdout.readline())["address"]

    async def listen() -> tuple[dict, dict]:
        channels: dict[int, dict] = {}
        got: dict[str, bytes] = {}
        protocols = ("foxglove.sdk.v1", "foxglove.websocket.v1")
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(address, protocols=protocols) as served,
        ):
            async for message in served:
                if message.type is aiohttp.WSMsgType.TEXT:
                    told = json.loads(message.data)
                    new = told.get("channels", []) if told["op"] == "advertise" else []
                    channels |= {c["id"]: c for c in new}
                    wanted = [{"id": c["id"], "channelId": c["id"]} for c in new]
                    await served.send_json({"op": "subscribe", "subscriptions": wanted})
                elif message.data[0] == 1:
                    number, _ = struct.unpack_from("<IQ", message.data, 1)
                    got[channels[number]["topic"]] = message.data[13:]
                if {"/joint_states", "/voltage", "/experiment", "/signal"} <= got.keys():
                    break
        return got, {c["topic"]: c for c in channels.values()}

    got, channels = asyncio.run(asyncio.wait_for(listen(), PATIENCE))
    assert channels["/joint_states"]["encoding"] == "cdr"
    assert channels["/joint_states"]["schemaEncoding"] == "ros2msg"
    assert len(deserialize(got["/joint_states"], KIND, "served").velocity) >= 1
    assert deserialize(got["/experiment"], "std_msgs/msg/Float64MultiArray", "served").data[0] >= 1
    host, _, port = address.removeprefix("ws://").rpartition(":")
    with closing(socket.create_connection((host, int(port)))):  # and says nothing: it held the end
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=PATIENCE)
    assert (process.returncode, errors) == (0, "")


@pytest.mark.parametrize("start", [-1.0, 5e9])
def test_a_time_that_no_stamp_holds_ends_no_export(start, tmp_path):
    """A machine's clock may say anything; the stamps are held at their ends."""
    strange = Experiment(1, start, 0.01, np.ones(4), np.ones(4))
    with BagWriter(tmp_path / "bag", machine="rotor") as writer:
        writer.write("experiment", strange, 1e9)
    found = read_bag(exported(tmp_path / "bag", tmp_path / "run.mcap"))
    assert len(list(found.messages("joint_states"))) == 4
