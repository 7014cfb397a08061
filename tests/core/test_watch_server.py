"""The live page's server with a real client: read-only, to its own names, never held up."""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
import signal
import socket
import threading
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any

import pytest
from watched import HOSTILE, feed, measured

from ldt_core.base.errors import BadInput
from ldt_core.base.experiment import Level
from ldt_core.views.watch.browser_files import assets
from ldt_core.views.watch.fleet import Fleet
from ldt_core.views.watch.playback_clock import PlaybackClock
from ldt_core.views.watch.watched_machine import MOST_STEPS

aiohttp = pytest.importorskip("aiohttp")

from aiohttp import ClientSession, test_utils  # noqa: E402

from ldt_core.views.watch import server  # noqa: E402
from ldt_core.views.watch.server import Pages, names_of  # noqa: E402

COUNT = 600
PATIENCE = 60.0  # s; a stalled machine is not what is tested
Task = Callable[[Fleet, ClientSession, str], Awaitable[None]]


def served(task: Task, host: str = "127.0.0.1", clock: PlaybackClock | None = None) -> None:
    """Run a client's task against a server."""

    async def both() -> None:
        fleet = Fleet()
        pages = Pages(fleet, assets("a test"), host, clock)
        async with test_utils.TestServer(pages.application()) as real, ClientSession() as client:
            try:
                await asyncio.wait_for(task(fleet, client, str(real.make_url("/"))), PATIENCE)
            finally:
                pages.close()

    asyncio.run(both())


async def events(client: ClientSession, url: str) -> AsyncIterator[tuple[str, Any]]:
    """Server-sent events as they come."""
    async with client.get(url) as answer:
        assert answer.headers["Content-Type"] == "text/event-stream"
        kind = ""
        async for line in answer.content:
            name, _, value = line.decode().rstrip("\n").partition(": ")
            if name == "event":
                kind = value
            elif name == "data":
                yield kind, json.loads(value)


async def until(stream: AsyncIterator, wanted: str, found: Callable[[Any], bool]) -> Any:
    """The first event of a kind of which something holds."""
    async for kind, data in stream:
        if kind == wanted and found(data):
            return data
    raise AssertionError("the stream has ended")


def test_the_page_loads_nothing_from_elsewhere():
    """Its files name no address but its own paths; no script or style stands in the page."""
    own = assets(f"a recording{HOSTILE}")
    page = own["/"][1].decode()
    assert set(re.findall(r'(?:src|href)="([^"]*)"', page)) == {
        *("/watch.js", "/watch.css", "/machines", "#", "data:,")
    }
    assert "<img" not in page
    assert re.findall(r"<script(?![^>]*(?:src|application/json))", page) == []
    assert not re.search(r"<style|\sstyle=|\son\w+=", page.replace(" onerror=alert(1)", ""))
    for _, content in own.values():
        text = content.decode().replace("http://www.w3.org/2000/svg", "")
        assert not re.search(r"@import|url\((?!data:)|importScripts|WebSocket", text)
        assert set(re.findall(r"https?://[^\s\"'*]*", text)) <= {
            "https://github.com/leeoniya/uPlot"
        }


def test_the_script_makes_no_markup_of_text():
    """What comes is written as text."""
    script = assets("")["/watch.js"][1].decode()
    ours = script[script.index('"use strict";\n(() =>') :]
    forbidden = r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\b|new Function"
    assert not re.search(forbidden, ours)


def test_every_answer_carries_the_policy():
    """Refusals and streams as well; no other site is let in."""

    async def task(fleet: Fleet, client: ClientSession, url: str) -> None:
        feed(fleet, "", 1)
        paths = ["", "watch.js", "machines", "experiment?machine=/&number=1", "events", "nothing"]
        for path in paths:
            async with client.get(url + path, headers={"Origin": "http://evil.example"}) as answer:
                headers = answer.headers
                assert answer.status == (404 if path == "nothing" else 200)
                assert "default-src 'none'; script-src 'self'" in headers["Content-Security-Policy"]
                assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
                assert headers["X-Content-Type-Options"] == "nosniff"
                assert not [h for h in headers if h.startswith("Access-Control")]

    served(task)


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE"])
def test_nothing_but_reading_is_answered(method):
    """Whatever the path."""

    async def task(_fleet: Fleet, client: ClientSession, url: str) -> None:
        for path in ("", "machines", "events"):
            async with client.request(method, url + path) as answer:
                assert answer.status == 405

    served(task)


@pytest.mark.parametrize(
    ("bound", "called", "status"),
    [
        ("127.0.0.1", "127.0.0.1:80", 200),
        ("127.0.0.1", "LocalHost", 200),
        ("127.0.0.1", "[::1]:8766", 200),
        ("127.0.0.1", "evil.example", 421),
        ("127.0.0.1", "localhost.evil.example", 421),
        ("127.0.0.1", "192.168.1.5", 421),
        ("0.0.0.0", "192.168.1.5:8766", 200),
        ("0.0.0.0", "evil.example", 421),
        ("bench", "bench:8766", 200),
    ],
)
def test_a_stranger_s_name_gets_nothing(bound, called, status):
    """A page whose name its owner lets point at this machine could read all otherwise."""

    async def task(_fleet: Fleet, client: ClientSession, url: str) -> None:
        for path in ("", "machines", "events"):
            async with client.get(url + path, headers={"Host": called}) as answer:
                assert answer.status == status

    served(task, bound)


def test_the_own_name_is_known_only_to_others():
    """Bound to this machine alone, it goes by no other name."""
    assert names_of("127.0.0.1") == {"127.0.0.1", "localhost", "::1"}
    assert len(names_of("0.0.0.0")) > 4


def test_a_browser_is_told_what_happens():
    """All at first, then what has changed; hostile words come through whole."""

    async def task(fleet: Fleet, client: ClientSession, url: str) -> None:
        feed(fleet, "/a", 1, words=HOSTILE, level=Level.POSITIVE)
        stream = events(client, f"{url}events?machine=/a")
        whole = await until(stream, "machine", lambda data: data["whole"])
        assert whole["diagnosis"]["sentence"] == f"It is unbalance{HOSTILE}."
        feed(fleet, "/a", 2)
        news = await until(stream, "machine", lambda data: data["steps"])
        assert [t["number"] for t in news["steps"]] == [2]
        feed(fleet, "/b", 1, level=Level.POSITIVE, error=9.0)
        cards = await until(stream, "fleet", lambda data: len(data["machines"]) == 2)
        assert cards["machines"][0]["key"] == "/b"
        samples = await (await client.get(f"{url}experiment?machine=/a&number=2")).json()
        assert samples["of"] == len(measured(2))
        await stream.aclose()

    served(task)


def test_a_machine_that_comes_later_is_told_of():
    """A page may be open before its graph."""

    async def task(fleet: Fleet, client: ClientSession, url: str) -> None:
        stream = events(client, f"{url}events?machine=/late")
        await until(stream, "missing", lambda data: data == {})
        feed(fleet, "/late", 1)
        told = await until(stream, "machine", lambda data: data["steps"])
        assert told["whole"]
        await stream.aclose()

    served(task)


def test_what_is_not_there_is_not_found():
    """Numbers that are none included."""

    async def task(fleet: Fleet, client: ClientSession, url: str) -> None:
        feed(fleet, "", 1)
        wrong = ("", "?machine=/", "?machine=/&number=2", "?machine=/&number=-1")
        more = ("?machine=/&number=1e3", f"?machine=/&number={'9' * 5000}", "?machine=..&number=1")
        for query in (*wrong, *more, "?machine=/&number=²"):
            async with client.get(f"{url}experiment{query}") as answer:
                assert answer.status == 404

    served(task)


def test_a_browser_that_does_not_read_holds_up_nobody():
    """The source goes on at its speed, another browser has the newest, memory stays."""

    async def task(fleet: Fleet, client: ClientSession, url: str) -> None:
        host, _, port = url.removeprefix("http://").rstrip("/").partition(":")
        own = socket.socket()
        own.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        own.connect((host, int(port)))
        reader, writer = await asyncio.open_connection(sock=own, limit=1024)
        writer.write(f"GET /events?machine=/ HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
        thread = threading.Thread(
            target=lambda: [feed(fleet, *turn, **more) for turn in turns], daemon=True
        )
        turns = [("", number) for number in range(1, COUNT + 1)]
        more = {"words": "x" * 900, "level": Level.POSITIVE}
        thread.start()
        stream = events(client, f"{url}events?machine=/")
        told = await until(stream, "machine", lambda data: COUNT in data["numbers"])
        assert told["card"]["experiment"] in (COUNT - 1, COUNT)
        await asyncio.to_thread(thread.join, PATIENCE)
        assert not thread.is_alive()
        taken = 0
        while f'"numbers":[{COUNT - MOST_STEPS + 1},'.encode() not in (
            data := await reader.read(65536)
        ):
            taken += len(data)
        # What was told it late is what is there now, not all that has been.
        assert taken < 5_000_000
        await stream.aclose()
        writer.close()

    served(task)


def test_one_browser_too_many_takes_the_place_of_the_one_most_behind(monkeypatch):
    """Those that take nothing keep nobody out; else the oldest leaves, and comes back by itself."""
    monkeypatch.setattr(server, "STREAMS", 3)

    async def task(_fleet: Fleet, client: ClientSession, url: str) -> None:
        open_now = [events(client, f"{url}events") for _ in range(3)]
        for stream in open_now:
            await until(stream, "fleet", lambda data: data["machines"] == [])
        late = events(client, f"{url}events")
        await until(late, "fleet", lambda data: data["machines"] == [])
        with pytest.raises((aiohttp.ClientError, StopAsyncIteration)):
            await until(open_now[0], "fleet", lambda data: data["machines"])
        for stream in (*open_now[1:], late):
            await stream.aclose()

    served(task)


def test_a_connection_that_asks_for_nothing_is_ended(monkeypatch):
    """Half-sent headers included; one that has asked stays open."""
    monkeypatch.setattr(server, "ASKED_WITHIN", 0.3)

    async def both() -> None:
        pages = Pages(Fleet(), assets("a test"), "127.0.0.1")
        async with test_utils.TestServer(pages.application()) as real, ClientSession() as client:
            watch = asyncio.create_task(pages.end_the_silent(real.runner.server))
            stream = events(client, str(real.make_url("/events")))
            await until(stream, "fleet", lambda data: data["machines"] == [])
            reader, writer = await asyncio.open_connection("127.0.0.1", real.port)
            writer.write(b"GET / HTTP/1.1\r\nHost: loc")
            with contextlib.suppress(ConnectionError):
                assert await asyncio.wait_for(reader.read(), PATIENCE) == b""
            writer.close()
            pages._notice()
            assert pages._open
            await stream.aclose()
            watch.cancel()
            pages.close()

    asyncio.run(both())


class Source:
    """Begins unless it fails before, and goes on until it is stopped.

    Args:
        failure: why it cannot begin, None if it can.
    """

    words, live = "a test", True

    def __init__(self, failure: Exception | None = None) -> None:
        self.failure = failure

    def run(self, fleet: Fleet, stop: threading.Event, begun: Callable[[], object]) -> None:
        if self.failure is not None:
            raise self.failure
        begun()
        assert stop.wait(PATIENCE)


def test_no_address_is_told_of_a_page_that_will_show_nothing():
    """What keeps its source from beginning is raised; one that has begun is told of."""
    told: list[str] = []
    where = (assets("a test"), "127.0.0.1", 0)
    failing = Source(BadInput("ROS 2", "a domain", "no node"))
    with pytest.raises(BadInput, match="no node"):
        asyncio.run(server.serve(Fleet(), failing, *where, told.append))
    assert told == []

    def ready(address: str) -> None:
        told.append(address)
        signal.raise_signal(signal.SIGINT)

    asyncio.run(server.serve(Fleet(), Source(), *where, ready))
    assert len(told) == 1


def test_a_recording_obeys_this_page_and_no_other():
    """Pause and seek by POST, from a page of this server; a graph has nothing of the kind."""
    clock = PlaybackClock(1.0, 40)

    async def task(_fleet: Fleet, client: ClientSession, url: str) -> None:
        own, path = url.rstrip("/"), f"{url}playback"
        for origin, query, status in (
            (own, "pause=1", 200),
            (own, "to=12", 200),
            (own, "to=-1", 400),
            (own, "pause=maybe", 400),
            ("http://evil.example", "pause=0", 405),
            ("null", "pause=0", 405),
        ):
            headers = {"Origin": origin}
            async with client.post(f"{path}?{query}", headers=headers) as answer:
                assert answer.status == status, (origin, query)
        async with client.post(f"{path}?pause=0") as answer:
            assert answer.status == 405
        async with client.get(f"{path}?pause=0") as answer:
            assert answer.status in (404, 405)

    served(task, clock=clock)
    assert clock.paused

    async def refused(_fleet: Fleet, client: ClientSession, url: str) -> None:
        headers = {"Origin": url.rstrip("/")}
        async with client.post(f"{url}playback?pause=1", headers=headers) as answer:
            assert answer.status == 405

    served(refused)
