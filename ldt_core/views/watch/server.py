"""The web server of the page: read-only, on this machine alone unless told otherwise.

| path | what |
|---|---|
| `/`, `/watch.js`, `/watch.css` | the page; nothing of it comes from elsewhere |
| `/events?machine=KEY` | server-sent events: `fleet` (overview), `machine` (what has changed) |
| `/machines` | the overview in JSON, for programs |
| `/experiment?machine=KEY&number=N` | samples of an experiment in JSON |
| `/playback?pause=1`, `?pause=0`, `?to=N` | POST, where a recording is played: pause, go on, seek |

Else only GET and HEAD are answered, only to the names that the server goes by (a page of a stranger
that lets its own name point here gets nothing), and no other site may read what comes.
"""

from __future__ import annotations

import asyncio
import errno
import ipaddress
import itertools
import json
import logging
import signal
import socket
import threading
from collections.abc import Awaitable, Callable
from typing import Any

from ldt_core.base.errors import BadInput, LdtError
from ldt_core.views.watch.fleet import Fleet
from ldt_core.views.watch.playback_clock import PlaybackClock
from ldt_core.views.watch.record_source import RecordSource

try:
    from aiohttp import web
except ImportError as error:
    raise LdtError(
        "the live page needs the library aiohttp, which is not installed: pip install 'ldt[watch]'"
    ) from error

HEARTBEAT = 1.0  # s, how soon a page learns that nothing happens, and that a node is silent
GATHER = 0.01  # s after a change: an experiment's prediction follows it closely
FASTEST = 0.05  # s between two events to one browser, faster than which nobody looks
STREAMS = 100  # browsers at a time; one more takes the place of the one that is most behind
ASKED_WITHIN = 10.0  # s in which who connects must have sent a request
STALLED = 10.0  # s in which a browser must take what it is sent
RETRY = 1000  # ms until a browser that lost the server tries again
CLOSING = 1.0  # s that the end waits for answers under way
PLAYBACK = "/playback"
LONGEST_NUMBER = 17  # digits, and one more than a browser counts exactly
LOOPBACK = ("localhost", "127.0.0.1", "::1")
HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
        "img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}
#: What strangers send that is no HTTP gets its answer, and is nobody's to read about.
SILENT = logging.Logger("watch", logging.CRITICAL + 1)
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class Pages:
    """What the server answers.

    Args:
        assets: path → (content type, content).
        host: that the server is bound to; decides by which names it may be called.
        clock: of the recording that is played, which a person may pause and set; None for a graph.
    """

    def __init__(
        self,
        fleet: Fleet,
        assets: dict[str, tuple[str, bytes]],
        host: str,
        clock: PlaybackClock | None = None,
    ) -> None:
        self.fleet, self.assets, self.clock = fleet, assets, clock
        self.names = names_of(host)
        self.open_to_others = not is_loopback(host)
        self._asked: set[Any] = set()  # connections that have sent a request
        self._places = itertools.count()
        self._open: dict[int, asyncio.WriteTransport | None] = {}  # by the order of their coming
        self._changed = asyncio.Event()
        self._closing = asyncio.Event()
        self._woken = self._news = False
        self._overview = (-1, -1.0, "")
        self._loop = asyncio.get_running_loop()
        fleet.on_change = self._notice

    def application(self) -> web.Application:
        """All paths, behind the checks."""
        app = web.Application(middlewares=[self._guard])
        for path in self.assets:
            app.router.add_get(path, self._asset)
        app.router.add_get("/events", self._events, allow_head=False)
        app.router.add_get("/machines", self._machines)
        app.router.add_get("/experiment", self._experiment)
        app.router.add_post(PLAYBACK, self._playback)
        return app

    def close(self) -> None:
        """End all streams."""
        self.fleet.on_change = lambda: None
        self._closing.set()
        self._changed.set()

    async def end_the_silent(self, server: web.Server) -> None:
        """End connections that have not asked for anything in time, until this is cancelled."""
        since: dict[Any, float] = {}
        while True:
            await asyncio.sleep(ASKED_WITHIN / 4)
            now = self._loop.time()
            self._asked &= set(server.connections)
            there = [c for c in server.connections if c not in self._asked]
            since = {c: since.get(c, now) for c in there}
            for connection, began in since.items():
                if now - began > ASKED_WITHIN and connection.transport is not None:
                    connection.transport.abort()

    def _notice(self) -> None:
        """Of the source's thread, which never waits: a browser that is behind gets the newest."""
        self._news = True
        if not self._woken:
            self._woken = True
            self._loop.call_soon_threadsafe(self._wake)

    def _wake(self) -> None:
        self._news = False
        self._changed.set()
        self._changed = asyncio.Event()
        # A thread that is woken at each message of thousands takes as long as the source itself.
        self._loop.call_later(GATHER, self._rest)

    def _rest(self) -> None:
        self._woken = False
        if self._news:
            self._notice()

    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        self._asked.add(request.protocol)
        try:
            if request.method not in ("GET", "HEAD") and not self._plays(request):
                raise web.HTTPMethodNotAllowed(request.method, ["GET", "HEAD"])
            if not self._called_by_name(request.headers.get("Host", "")):
                raise web.HTTPMisdirectedRequest(text="no such host here\n")
            response = await handler(request)
        except web.HTTPException as refusal:
            refusal.headers.update(HEADERS)
            raise
        if not response.prepared:
            response.headers.update(HEADERS)
        return response

    def _plays(self, request: web.Request) -> bool:
        """Whether a page of this server asks for another moment of a recording."""
        if self.clock is None or (request.method, request.path) != ("POST", PLAYBACK):
            return False
        # A browser says from which page a request comes; a stranger's may not.
        scheme, _, rest = request.headers.get("Origin", "").partition("://")
        return scheme in ("http", "https") and rest == request.headers.get("Host", "")

    async def _playback(self, request: web.Request) -> web.Response:
        pause, to = request.query.get("pause", ""), request.query.get("to", "")
        assert self.clock is not None
        if pause in ("0", "1"):
            self.clock.pause(pause == "1")
        elif to.isascii() and to.isdecimal() and len(to) < LONGEST_NUMBER:
            self.clock.seek(int(to))
        else:
            raise web.HTTPBadRequest(text="expected pause=0, pause=1 or to=NUMBER\n")
        self._notice()
        return web.Response(text=_json(self.clock.state()), content_type="application/json")

    def _called_by_name(self, called: str) -> bool:
        name = host_name(called)
        if name in self.names:
            return True
        # An address cannot be made to point here; a name can.
        return self.open_to_others and _address(name) is not None

    async def _asset(self, request: web.Request) -> web.Response:
        kind, content = self.assets[request.path]
        return web.Response(body=content, content_type=kind, charset="utf-8")

    async def _machines(self, _request: web.Request) -> web.Response:
        return web.Response(text=self._overview_now(), content_type="application/json")

    def _overview_now(self) -> str:
        """The overview in JSON, made once for all browsers."""
        count, made, text = self._overview
        now = self._loop.time()
        if count != self.fleet.count or now - made > HEARTBEAT / 2:
            count, text = self.fleet.count, _json(self.fleet.overview())
            self._overview = (count, now, text)
        return text

    async def _experiment(self, request: web.Request) -> web.Response:
        number = request.query.get("number", "")
        key = request.query.get("machine", "")
        digits = number.isascii() and number.isdecimal() and len(number) < LONGEST_NUMBER
        found = self.fleet.experiment(key, int(number)) if digits else None
        if found is None:
            raise web.HTTPNotFound(text="no samples of such an experiment\n")
        return web.Response(text=_json(found), content_type="application/json")

    async def _events(self, request: web.Request) -> web.StreamResponse:
        while len(self._open) >= STREAMS:
            self._make_room()
        response = web.StreamResponse(headers={**HEADERS, "Content-Type": "text/event-stream"})
        key = next(self._places)
        place = self._open[key] = request.transport
        try:
            await response.prepare(request)
            await response.write(f"retry: {RETRY}\n\n".encode())
            await self._tell(response, request.query.get("machine", ""))
        except (ConnectionError, TimeoutError):
            if place is not None:
                place.abort()  # the browser has left, or takes nothing any more
        finally:
            self._open.pop(key, None)
        return response

    def _make_room(self) -> None:
        """End the stream that has most to take yet, of those alike the oldest."""

        def behind(key: int) -> tuple[int, int]:
            there = self._open[key]
            return (there.get_write_buffer_size() if there is not None else 0), -key

        leaving = self._open.pop(max(self._open, key=behind))
        if leaving is not None:
            leaving.abort()

    async def _tell(self, response: web.StreamResponse, key: str) -> None:
        """Tell one browser the newest there is, as fast as it takes it."""
        since, known = 0, ""
        while not self._closing.is_set():
            changed = self._changed
            overview = self._overview_now()
            if overview != known:
                known = overview
                await self._send(response, f"event: fleet\ndata: {overview}\n\n".encode())
            machine = self.fleet.machine(key, since) if key else None
            if machine is not None:
                since = machine["count"]
                await self._send(response, f"event: machine\ndata: {_json(machine)}\n\n".encode())
            elif key:
                await self._send(response, b"event: missing\ndata: {}\n\n")
            await asyncio.sleep(FASTEST)
            try:
                await asyncio.wait_for(changed.wait(), HEARTBEAT)
                await asyncio.sleep(GATHER)
            except TimeoutError:
                await self._send(response, b": still here\n\n")

    async def _send(self, response: web.StreamResponse, data: bytes) -> None:
        """Raises TimeoutError where the browser takes nothing."""
        await asyncio.wait_for(response.write(data), STALLED)


async def serve(
    fleet: Fleet,
    source: RecordSource,
    assets: dict[str, tuple[str, bytes]],
    host: str,
    port: int,
    on_ready: Callable[[str], None],
) -> None:
    """Feed the fleet and serve it until SIGINT or SIGTERM.

    Args:
        source: runs on a thread of its own.
        port: to bind to, 0 for any free one.
        on_ready: told the address once it answers, and the source has begun.

    Raises:
        BadInput: an address that cannot be bound to.
        Exception: what the source failed with.
    """
    loop, ended = asyncio.get_running_loop(), asyncio.Event()
    settled = asyncio.Event()  # the source has begun, or nobody waits for it any more
    pages = Pages(fleet, assets, host, getattr(source, "clock", None))
    runner = web.AppRunner(
        pages.application(), access_log=None, logger=SILENT, shutdown_timeout=CLOSING
    )
    await runner.setup()
    stop, failed = threading.Event(), list[BaseException]()

    def end() -> None:
        ended.set()
        settled.set()

    def feed() -> None:
        try:
            source.run(fleet, stop, lambda: loop.call_soon_threadsafe(settled.set))
        except BaseException as error:
            failed.append(error)
            loop.call_soon_threadsafe(end)

    assert runner.server is not None
    silent = asyncio.create_task(pages.end_the_silent(runner.server))
    thread = threading.Thread(target=feed, name="source")
    try:
        site = web.TCPSite(runner, host, port)
        try:
            await site.start()
        except OSError as error:
            raise _unbound(host, port, error) from error
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, end)
        thread.start()
        await settled.wait()
        if not ended.is_set():
            on_ready(_address_of(runner, host))
        await ended.wait()
    finally:
        stop.set()
        silent.cancel()
        pages.close()
        await runner.cleanup()
        if thread.ident is not None:
            await asyncio.to_thread(thread.join)
    if failed:
        raise failed[0]


def is_loopback(host: str) -> bool:
    """Whether nobody but this machine can reach a server that is bound to this host."""
    address = _address(host)
    return host == "localhost" or (address is not None and address.is_loopback)


def names_of(host: str) -> set[str]:
    """Names by which a server that is bound to this host may be called."""
    names = {*LOOPBACK, host.lower().strip("[]")}
    if not is_loopback(host):
        own = socket.gethostname().lower()
        names |= {own, f"{own}.local", socket.getfqdn().lower()}
    return names


def host_name(called: str) -> str:
    """The name in a Host header, without its port.

    >>> host_name("LocalHost:8766"), host_name("[::1]:80"), host_name("a.b")
    ('localhost', '::1', 'a.b')
    """
    if called.startswith("["):
        return called[1:].partition("]")[0].lower()
    return called.partition(":")[0].lower()


def _address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(name)
    except ValueError:
        return None


def _address_of(runner: web.AppRunner, host: str) -> str:
    port = runner.addresses[0][1]
    name = "127.0.0.1" if host in ("0.0.0.0", "::") else host
    return f"http://{f'[{name}]' if ':' in name else name}:{port}/"


def _unbound(host: str, port: int, error: OSError) -> BadInput:
    if error.errno == errno.EADDRINUSE:
        return BadInput(f"port {port}", "one that is free (--port)", "one that is taken")
    if error.errno == errno.EACCES:
        return BadInput(f"port {port}", "one that this user may open (--port)", error.strerror)
    reason = " ".join(str(error.strerror or error).split())
    return BadInput(f"host {host!r}", "an address of this machine (--host)", reason)


def _json(data: Any) -> str:
    return json.dumps(data, allow_nan=False, separators=(",", ":"))
