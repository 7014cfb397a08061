"""CONTRACT "Recordings", line by line, on a folder that the writer made."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap.records import Chunk, Metadata
from mcap.stream_reader import StreamReader

import msgs_config
from ldt_core.base.experiment import (
    Action,
    Adaptation,
    Experiment,
    Level,
    ModelRecord,
    Prediction,
    Signal,
)
from ldt_core.recording.messages import DIAGNOSTICS, MULTI_ARRAY, STRING, schema
from ldt_core.recording.writer import BagWriter

TYPES = {
    "/machine_1/experiment": MULTI_ARRAY,
    "/machine_1/prediction": MULTI_ARRAY,
    "/machine_1/signal": DIAGNOSTICS,
    "/machine_1/model": STRING,
    "/machine_1/adaptation": DIAGNOSTICS,
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("bags") / "run"
    row = np.linspace(0, 1, 10)
    with BagWriter(path, "rotor", "machine_1") as bag:
        bag.write("experiment", Experiment(1, 100.0, 0.1, row, row), 101.0)
        bag.write("prediction", Prediction(1, 100.0, 0.1, 0, row), 101.5)
        bag.write("signal", Signal(1, Level.WARNING, "lddm", 0, 0.5), 102.0)
        bag.write("model", ModelRecord(1, "linear", (1,), {"a": 1.0}), 102.5)
        bag.write("adaptation", Adaptation(1, Action.ADAPTED, 1, "better"), 103.0)
    return path


@pytest.fixture(scope="module")
def information(folder) -> dict:
    return yaml.safe_load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]


def test_the_folder_holds_metadata_and_an_mcap_file(folder):
    """`metadata.yaml` and MCAP file(s), nothing else."""
    assert sorted(f.name for f in folder.iterdir()) == ["metadata.yaml", "run_0.mcap"]


def test_the_metadata_is_what_rosbag2_of_jazzy_writes(information):
    """Version 9 with each of its keys, of the types that rosbag2 parses."""
    assert information["version"] == 9
    assert information["storage_identifier"] == "mcap"
    assert information["relative_file_paths"] == ["run_0.mcap"]
    assert information["starting_time"] == {"nanoseconds_since_epoch": 101 * 10**9}
    assert information["duration"] == {"nanoseconds": 2 * 10**9}
    assert information["message_count"] == 5
    assert (information["compression_format"], information["compression_mode"]) == ("", "")
    assert information["ros_distro"] == "jazzy"
    assert information["custom_data"] == {"machine": "rotor"}
    (file,) = information["files"]
    assert file == {
        "path": "run_0.mcap",
        "starting_time": {"nanoseconds_since_epoch": 101 * 10**9},
        "duration": {"nanoseconds": 2 * 10**9},
        "message_count": 5,
    }


def test_each_topic_is_listed_with_type_count_hash_and_declared_qos(information):
    """The QoS profile is the one in `msgs_config`."""
    listed = {
        t["topic_metadata"]["name"]: (t["topic_metadata"], t["message_count"])
        for t in information["topics_with_message_count"]
    }
    assert {name: meta["type"] for name, (meta, _) in listed.items()} == TYPES
    for name, (meta, count) in listed.items():
        declared = msgs_config.topics()[name.rpartition("/")[2]]
        profile = msgs_config.qos_profiles()[declared["qos"]]
        (offered,) = meta["offered_qos_profiles"]
        lease = offered["liveliness_lease_duration"]["sec"]
        known = {**offered, "lease": float(lease)}
        assert {k: known[k] for k in profile} == profile
        assert ("lease" in profile) == (lease < 3600)
        assert meta["serialization_format"] == "cdr"
        assert meta["type_description_hash"] == schema(meta["type"])[1]
        assert count == 1
    (offered,) = listed["/machine_1/model"][0]["offered_qos_profiles"]
    assert (offered["reliability"], offered["durability"]) == ("reliable", "transient_local")


def test_the_file_has_the_profile_and_encodings_of_the_contract(folder):
    """Profile ros2, schemas ros2msg, messages cdr, QoS and type hash per channel."""
    with (folder / "run_0.mcap").open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
    assert {c.topic: summary.schemas[c.schema_id].name for c in summary.channels.values()} == TYPES
    for channel in summary.channels.values():
        assert summary.schemas[channel.schema_id].encoding == "ros2msg"
        assert channel.message_encoding == "cdr"
        (profile,) = yaml.safe_load(channel.metadata["offered_qos_profiles"])
        assert profile["reliability"] == "reliable"
        assert channel.metadata["topic_type_hash"].startswith("RIHS01_")
    assert summary.chunk_indexes
    assert all(i.message_index_offsets for i in summary.chunk_indexes)
    assert summary.metadata_indexes
    assert not summary.attachment_indexes


def test_chunks_are_compressed_and_the_metadata_is_inside_the_file_too(folder, information):
    """A bare .mcap file knows what its folder's metadata.yaml says."""
    with (folder / "run_0.mcap").open("rb") as stream:
        records = list(StreamReader(stream, emit_chunks=True, validate_crcs=True).records)
    assert {r.compression for r in records if isinstance(r, Chunk)} == {"zstd"}
    (metadata,) = [r for r in records if isinstance(r, Metadata)]
    assert metadata.name == "rosbag2"
    assert yaml.safe_load(metadata.metadata["serialized_metadata"]) == information


@pytest.mark.parametrize("kind", sorted({*TYPES.values()}))
def test_type_hashes_and_definitions_are_those_of_the_ros_installation(kind):
    """The hash of `share/<package>/msg/<Name>.json`, and the same fields in the definition."""
    package, _, name = kind.split("/")
    share = Path(sys.prefix) / "share" / package / "msg" / f"{name}.json"
    if not share.exists():
        pytest.skip("ROS 2 is not installed here")
    stored = json.loads(share.read_text())["type_hashes"]
    hashes = {entry["type_name"]: entry["hash_string"] for entry in stored}
    text, digest = schema(kind)
    assert digest == hashes[kind]
    named = {line[5:] for line in text.splitlines() if line.startswith("MSG: ")}
    assert named == {t.replace("/msg/", "/") for t in hashes} - {kind.replace("/msg/", "/")}
    source = share.with_suffix(".msg").read_text().splitlines()
    fields = [line.partition("#")[0].split() for line in source]
    fields = [f[:2] for f in fields if f and "=" not in " ".join(f)]
    written = [line.split()[:2] for line in text.partition("=" * 80)[0].splitlines() if line]
    assert [(t.rpartition("/")[2], n) for t, n in written if "=" not in n] == [
        (t.rpartition("/")[2], n) for t, n in fields
    ]
