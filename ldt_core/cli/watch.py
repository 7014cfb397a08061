"""`ldt watch`: the twin live in a browser."""

from __future__ import annotations

import click

from ldt_core.cli.options import (
    json_option,
    namespace_option,
    playback_rate_option,
    serving_options,
)
from ldt_core.cli.terminal import echo_address

PORT = 8766


@click.command("watch", short_help="A running graph or a recording, live in a browser.")
@click.argument("recording", required=False)
@playback_rate_option
@serving_options(PORT, "look")
@namespace_option
@json_option
def command(
    recording: str | None, rate: str, host: str, port: int, namespace: str, as_json: bool
) -> None:
    """Show the running graph, or a playback of RECORDING, live in the browser, until Ctrl-C.

    The page shows the current experiment, measured and predicted; the state of machine and model as
    a traffic light; adaptations; the last diagnosis; the health of the nodes. You can pause a
    recording and jump to any experiment. All machines in the ROS domain are found automatically and
    listed worst first. Nothing is sent to the graph, and nothing is loaded from a network.

    Example: ldt watch my_run --rate 20
    """
    import asyncio
    from functools import partial

    from ldt_core.views.watch.browser_files import assets
    from ldt_core.views.watch.fleet import Fleet
    from ldt_core.views.watch.record_source import Playback, RecordSource, graph
    from ldt_core.views.watch.server import serve

    source: RecordSource
    if recording:
        source = Playback(recording, namespace, rate)
        source.stays = True
    else:
        source = graph(namespace)

    others = "see the machines, unencrypted and without a password"
    ready = partial(echo_address, as_json, "watched", source.words, host, others)
    fleet = Fleet(source.live)
    asyncio.run(serve(fleet, source, assets(source.words), host, port, ready))
