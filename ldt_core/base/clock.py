"""The computer's clock, where what it says can be recorded."""

from __future__ import annotations

import time
from datetime import UTC, datetime, timedelta

from ldt_core.base.errors import BadInput

#: The year 2261: a recording counts its nanoseconds in 64 bits [s since the epoch].
LATEST = 9.2e9


def computer_time(latest: float = LATEST, holder: str = "a recording") -> float:
    """Now [s since the epoch].

    Args:
        latest: that the `holder` can hold [s since the epoch].

    Raises:
        BadInput: the clock is not set, as where its battery is empty.
    """
    now = time.time()
    if not 0 <= now <= latest:
        epoch = datetime(1970, 1, 1, tzinfo=UTC)
        held = f"a time from 1970 to {(epoch + timedelta(seconds=latest)).year}, as {holder} holds"
        raise BadInput("the computer's clock", held, f"{epoch + timedelta(seconds=now):%F %T} UTC")
    return now
