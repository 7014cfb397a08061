"""`ldt serve`: a graph or a recording for Foxglove and Lichtblick."""

from __future__ import annotations

import click

from ldt_core.cli.options import (
    json_option,
    namespace_option,
    playback_rate_option,
    serving_options,
)
from ldt_core.cli.terminal import echo_address

PORT = 8765  # that these programs propose


@click.command("serve", short_help="A graph or a recording for Foxglove and Lichtblick.")
@click.argument("recording", required=False)
@playback_rate_option
@click.option("--repeat", is_flag=True, help="Play RECORDING again and again.")
@serving_options(PORT, "listen")
@namespace_option
@json_option
def command(
    recording: str | None,
    rate: str,
    repeat: bool,
    host: str,
    port: int,
    namespace: str,
    as_json: bool,
) -> None:
    """Serve the topics of the running graph, or of a playback of RECORDING, until Ctrl-C.

    In Foxglove or Lichtblick: Open connection, Foxglove WebSocket, the printed address; then
    Layouts, Import from file, msgs_config/layouts/foxglove.json. Each sample is a separate message,
    so that curves can be drawn. The server is read-only. Any page in a browser on this computer may
    connect, as the web versions of these programs do. A recording needs no ROS.

    Example: ldt serve my_run --rate 5
    """
    import threading

    from ldt_core.base.stopping import stop_on_signals
    from ldt_core.views.export.foxglove_relay import FoxgloveRelay
    from ldt_core.views.watch.record_source import Playback, RecordSource, graph

    played = Playback(recording, namespace, rate) if recording else None
    source: RecordSource = played or graph(namespace)
    relay = FoxgloveRelay(source.live, host, port, f"LDT: {source.words}")

    for bag in played.bags if played else ():  # before anybody can ask for their topics
        relay.expect(bag.namespace, bag.machine)

    def elapsed() -> float | None:
        found = played.clock.state()["elapsed"] if played and played.rate is not None else None
        return None if found is None else float(found)

    with stop_on_signals() as stop:
        samples = threading.Thread(target=relay.play, args=(elapsed, stop), daemon=True)
        samples.start()
        address = f"ws://{host}:{relay.port}"
        echo_address(as_json, "served", source.words, host, "listen", address)
        try:
            source.run(relay, stop, lambda: None)
            while repeat and played and not stop.is_set():
                played.clock.rewind()
                relay.reset()
                source.run(relay, stop, lambda: None)
            stop.wait()
        finally:
            stop.set()
            samples.join()
            relay.stop()
