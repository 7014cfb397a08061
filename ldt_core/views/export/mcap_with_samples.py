"""A recording with its samples as messages of their own, for the layouts of stock tools."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from ldt_core.base.experiment import Experiment
from ldt_core.recording.bag import Bag
from ldt_core.recording.mcap_writer import McapWriter, describe_channel
from ldt_core.recording.metadata import TopicInformation, bag_information, text_of
from ldt_core.views.export.predicted_runs import Predictions
from ldt_core.views.export.sample_messages import KIND, sample_messages


def write_mcap(bag: Bag, file: Path) -> int:
    """Write one file with all messages of a machine and all of its samples; the number of these.

    Samples of an experiment stand before it, since it was recorded when it had ended.

    Raises:
        RecordingError, ExperimentError: as `Bag.experiments`.
        OSError: the file exists or cannot be written.
    """
    predictions = Predictions(bag)
    file.unlink(missing_ok=True)
    writer = McapWriter(file)
    channels: dict[str, int] = {}
    kinds: dict[str, str] = {}
    counts: Counter[str] = Counter()

    def add(topic: str, kind: str, data: bytes, time_ns: int) -> None:
        if topic not in channels:
            kinds[topic] = kind
            channels[topic] = writer.register(*describe_channel(topic, kind))
        writer.add(channels[topic], data, time_ns, counts[topic])
        counts[topic] += 1

    samples = 0
    streamed = [t for t in ("joint_states", "voltage", "current") if bag.topic(t)]
    try:
        for raw, record in bag.usable(bag.messages()):
            if isinstance(record, Experiment) and not streamed:
                for made in sample_messages(predictions.beside(record), bag.machine):
                    add(f"{bag.namespace}/{made.topic}", KIND, made.data, made.time_ns)
                samples += len(record)
            add(raw.topic, raw.kind, raw.data, raw.time_ns)
        topics = [TopicInformation(t, kinds[t], n).entry() for t, n in counts.items()]
        about = bag_information(topics, [writer.facts], {"machine": bag.machine})
        writer.finish(text_of(about))
    except BaseException:
        writer.abandon()
        file.unlink(missing_ok=True)
        raise
    return samples
