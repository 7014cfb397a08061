"""A stranger in the graph: sends messages that nobody can use, and experiments once more.

python -m tests.meddler RECORDING [--seed 1]

It takes the graph's last recorded experiment out of the recording and sends it again as it is, and
on every topic of the loop a message that is none.
"""

from __future__ import annotations

import argparse
import random
import sys
from collections import deque
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent / "ros"))
from stranger import Stranger

from ldt_core.recording.bag import read_bag
from ldt_core.restart.recorded_run import LOOP
from ldt_ros.graph.environment import prepare


def main() -> int:
    """Meet those who listen, send, and leave."""
    parser = argparse.ArgumentParser(prog="python -m tests.meddler", description=__doc__)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    prepare()
    from ldt_ros.nodes.interfaces import message_type

    again = next(iter(deque(read_bag(given.recording).records("experiment"), 1)))
    chance = random.Random(given.seed)
    stranger = Stranger()
    messages = [("experiment", again)]
    messages += [(topic, nonsense(message_type(topic), chance)) for topic in LOOP]
    chance.shuffle(messages)
    for topic, message in messages:
        stranger.send(topic, message)
        stranger.spin(chance.uniform(0.0, 0.2))
    stranger.close()
    return 0


def nonsense(kind: Any, chance: random.Random) -> Any:
    """A message of a type, empty or with something in it."""
    message = kind()
    if hasattr(message, "layout") and chance.random() < 0.5:
        message.data = [chance.choice((0.0, float("nan"), float("inf"), 1e300))] * 50
    if hasattr(message, "layout") or hasattr(message, "status"):
        return message
    message.data = chance.choice(("", "{}", "null", '{"version": -1}', "<b>" * 1000))
    return message


if __name__ == "__main__":
    sys.exit(main())
