"""The live page in a real browser: what a person at the bench does with it, and what it shows."""

from __future__ import annotations

import asyncio
import re
import shutil
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from watched import HOSTILE, feed, health, measured, predicted

from ldt_core.base.experiment import Experiment, Level
from ldt_core.views.watch.browser_files import assets
from ldt_core.views.watch.fleet import Fleet

pytest.importorskip("aiohttp")
playwright = pytest.importorskip("playwright.sync_api")

from aiohttp import web  # noqa: E402

from ldt_core.views.watch.server import Pages  # noqa: E402

pytestmark = pytest.mark.slow

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
PATIENCE = 60.0  # s; a stalled machine is not what is tested
LENGTH = 600  # samples of 0.01 s: 6 s
SERIOUS = ("moderate", "serious", "critical")


class Served:
    """A fleet and its server, on a thread of its own; at the same port when started again."""

    def __init__(self) -> None:
        self.fleet, self.port = Fleet(clock=lambda: 0.0), 0  # nobody falls silent
        self.start()

    def start(self) -> None:
        """Answer from now on."""
        ready = threading.Event()

        async def run() -> None:
            self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
            pages = Pages(self.fleet, assets("the test"), "127.0.0.1")
            runner = web.AppRunner(pages.application(), shutdown_timeout=0.2)
            await runner.setup()
            await web.TCPSite(runner, "127.0.0.1", self.port, reuse_address=True).start()
            self.port = runner.addresses[0][1]
            ready.set()
            await self._stop.wait()
            pages.close()
            await runner.cleanup()

        self._thread = threading.Thread(target=lambda: asyncio.run(run()))
        self._thread.start()
        assert ready.wait(PATIENCE)

    def stop(self) -> None:
        """Answer no more."""
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(PATIENCE)

    @property
    def url(self) -> str:
        """Of the page."""
        return f"http://127.0.0.1:{self.port}/"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A headless Chromium."""
    program = next((b for b in map(shutil.which, BROWSERS) if b), None)
    if program is None:
        pytest.skip("no Chromium is installed")
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(
            executable_path=program, args=["--no-sandbox", "--disable-gpu"]
        )
        yield chromium
        chromium.close()


@pytest.fixture
def served() -> Iterator[Served]:
    """Two machines, of which /b is the worse."""
    one = Served()
    for number in range(1, 13):
        feed(one.fleet, "/a", number, 0.5, length=LENGTH, state="holds", adequacy=1.0)
        feed(one.fleet, "/b", number, 2.0, length=LENGTH)
    known = {"state": "changed", "adequacy": 14.2}
    feed(one.fleet, "/b", 13, 8.0, Level.POSITIVE, length=LENGTH, **known)
    one.fleet.feed("", "/diagnostics", health("b/twin"))
    yield one
    one.stop()


@pytest.fixture(params=[(1400, "light"), (390, "dark")], ids=["desk", "phone"])
def page(request, browser, served) -> Iterator[Any]:
    """The page at a desk, and on a phone at night; it may complain of nothing."""
    width, scheme = request.param
    size = {"width": width, "height": 850}
    context = browser.new_context(viewport=size, color_scheme=scheme)
    context.set_default_timeout(1000 * PATIENCE)
    one = context.new_page()
    complaints: list[str] = []
    asked: list[str] = []
    one.on("pageerror", lambda error: complaints.append(str(error)))
    one.on("dialog", lambda dialog: complaints.append(dialog.message))
    one.on("request", lambda r: asked.append(r.url))
    one.on(
        "console",
        lambda m: complaints.append(m.text) if "ERR_CONNECTION_REFUSED" not in m.text else None,
    )
    one.goto(served.url)
    yield one
    assert [c for c in complaints if "ERR_" not in c] == []
    assert [u for u in asked if not u.startswith((served.url, "data:"))] == []
    context.close()


def text(page: Any, selector: str) -> str:
    return page.inner_text(selector)


def until(page: Any, expression: str) -> None:
    """Let time pass until it holds; the page's policy forbids to wait for it there."""
    end = time.monotonic() + PATIENCE
    while not page.evaluate(expression):
        assert time.monotonic() < end, f"not within {PATIENCE:g} s: {expression}"
        page.wait_for_timeout(30)


def drawn(page: Any, number: int) -> None:
    until(page, f"(document.body.dataset.drawn || '').startsWith('{number}:')")


def choose(page: Any, key: str) -> None:
    page.click(f'#cards a[href="#machine={key.replace("/", "%2F")}"]')
    until(page, f"document.getElementById('one-title').textContent.includes('{key[1:]}')")


def test_the_worst_machine_is_first_and_a_click_shows_it(page):
    """With its state in words; the way back leads to all, and to another machine."""
    page.wait_for_selector("#cards li:nth-child(2)")
    cards = page.locator("#cards li")
    assert "b\n" in cards.nth(0).inner_text()
    assert "machine changed" in cards.nth(0).inner_text()
    assert "error 14 times the noise, detector: alarm" in cards.nth(0).inner_text()
    assert "model holds" in cards.nth(1).inner_text()
    choose(page, "/b")
    drawn(page, 13)
    assert text(page, "#word") == "machine changed"
    assert "detector: alarm" in text(page, "#aside")
    assert "Largest error 8 rad/s" in text(page, "#sentence")
    assert "It is unbalance. (after experiment 13)" in text(page, "#diagnosis")
    assert "version 13 of the kind model" in text(page, "#events")
    assert "twin: running" in " ".join(text(page, "#nodes").split())
    page.click("#back a")
    choose(page, "/a")
    drawn(page, 12)
    assert text(page, "#word") == "model holds"
    assert page.locator("canvas").count() == 6


def test_an_experiment_is_drawn_as_it_arrives(page, served):
    """Without a press of a key: first measured, then with its prediction; the light follows."""
    page.wait_for_selector("#cards li")
    choose(page, "/a")
    drawn(page, 12)
    new = measured(13, length=LENGTH)
    served.fleet.feed("/a", "experiment", new)
    drawn(page, 13)
    assert "not judged yet" in text(page, "#told")
    assert "predicted" not in text(page, "[data-key=speed]")
    served.fleet.feed("/a", "prediction", predicted(new, 7.0))
    until(page, "document.querySelector('[data-key=speed]').textContent.includes('95 % band')")
    known = {"state": "inadequate", "adequacy": 4.0}
    feed(served.fleet, "/a", 14, 7.0, Level.WARNING, length=LENGTH, **known)
    drawn(page, 14)
    until(page, "document.getElementById('word').textContent.includes('not good')")
    assert page.locator("#status .light .lamp.lit.vague").count() == 1
    assert page.locator("#status .light .lamp.lit").count() == 1


#: Colours of a row of pixels in the strip of the states, from left to right, each once in a row.
STRIP = """() => {
  const canvas = document.querySelector("[data-plot=error] canvas"), found = [];
  const row = canvas.getContext("2d").getImageData(0, 10 * devicePixelRatio, canvas.width, 1).data;
  for (let i = 0; i < row.length; i += 4) {
    const [r, g, b, a] = row.slice(i, i + 4);
    const own = a === 0 ? "" : a < 250 ? "pale" : r > g && g > b ? (g > 140 ? "amber" : "red")
      : g > r && g > b ? "green" : "blue";
    if (own !== found[found.length - 1]) found.push(own);
  }
  return found.filter((own) => own && own !== "blue").filter((own, i, all) => own !== all[i - 1]);
}"""


def test_each_experiment_has_a_cell_in_the_colour_of_its_state(page, served):
    """Above the errors, with how many of each there are in words; what is not judged is pale."""
    page.wait_for_selector("#cards li")
    choose(page, "/a")
    for number, state in ((13, "inadequate"), (14, "changed"), (15, "")):
        more = {"state": state, "adequacy": 5.0}
        feed(served.fleet, "/a", number, 3.0, length=LENGTH, **more)
        drawn(page, number)
    until(page, "document.getElementById('states').textContent.includes('not judged: 1')")
    words = ["model holds: 12", "machine changed: 1", "model inadequate", "not judged: 1"]
    assert all(one in text(page, "#states") for one in words)
    cells = page.evaluate(STRIP)
    assert cells == ["green", "amber", "red", "pale"]


def test_an_experiment_is_chosen_and_stays(page, served):
    """By list, by button, and in the plot over the run; following it again is one click."""
    page.wait_for_selector("#cards li")
    choose(page, "/b")
    drawn(page, 13)
    page.select_option("#choice", "4")
    drawn(page, 4)
    assert text(page, "#told").startswith("Experiment 4: error 2 rad/s")
    page.click("#older")
    drawn(page, 3)
    feed(served.fleet, "/b", 14, 9.0, Level.POSITIVE, length=LENGTH)
    until(page, "document.getElementById('aside').textContent.includes('experiment 14')")
    assert text(page, "#experiment-title") == "Experiment 3"
    over = page.locator("[data-plot=error] .u-over")
    over.scroll_into_view_if_needed()
    box = over.bounding_box()
    page.mouse.move(box["x"] + box["width"] * 9 / 13, box["y"] + 20)  # of 1 to 14
    page.mouse.down()
    page.mouse.up()
    drawn(page, 10)
    assert not page.is_checked("#follow")
    page.check("#follow")
    drawn(page, 14)


def test_plots_are_hovered_and_zoomed_and_stay_so_while_experiments_arrive(page, served):
    """By mouse and by keyboard."""
    page.wait_for_selector("#cards li")
    choose(page, "/a")
    drawn(page, 12)
    over = page.locator("[data-plot=speed] .u-over")
    over.scroll_into_view_if_needed()
    box = over.bounding_box()

    def at(share: float) -> tuple[float, float]:
        return box["x"] + box["width"] * share, box["y"] + 40

    page.mouse.move(*at(0.5))
    until(page, "document.querySelector('[data-key=speed] output').textContent !== ''")
    hovered = [float(v) for v in page.locator("[data-key=speed] output").all_inner_texts()]
    assert 29 < hovered[0] < 31
    page.mouse.down()
    page.mouse.move(*at(0.6), steps=3)
    page.mouse.move(*at(0.75), steps=3)
    page.mouse.up()
    page.focus("#experiment-plots")
    page.mouse.move(*at(0.02))
    page.keyboard.press("ArrowRight")
    seconds = "parseFloat(document.getElementById('read').textContent)"
    until(page, f"{seconds} > 2.8 && {seconds} < 3.5")
    feed(served.fleet, "/a", 13, 0.5, length=LENGTH)
    drawn(page, 13)
    page.keyboard.press("ArrowRight")
    until(page, f"{seconds} > 2.8 && {seconds} < 3.5")
    page.keyboard.press("0")
    page.mouse.move(*at(0.02))
    page.keyboard.press("ArrowRight")
    until(page, f"{seconds} < 0.5")


def test_names_from_topics_stay_text(page, served):
    """Whatever they contain; nothing of them runs or loads."""
    page.wait_for_selector("#cards li")
    feed(served.fleet, "/a", 13, 9.0, Level.POSITIVE, HOSTILE, length=LENGTH)
    served.fleet.misread("/a", f"why{HOSTILE}")
    served.fleet.feed("", "/diagnostics", health("a/twin", f"rig{HOSTILE}", f"said{HOSTILE}"))
    served.fleet.say(f"playing{HOSTILE}")
    choose(page, "/a")
    drawn(page, 13)
    until(page, "document.getElementById('unreadable').textContent.includes('why')")
    for place in (
        "#diagnosis",
        "#events",
        "#told",
        "#one-title",
        "#unreadable",
        "#state",
        "#nodes",
    ):
        assert "<img src=x onerror=alert(1)>" in text(page, place)
    assert page.locator("img").count() == 0


def test_it_comes_back_by_itself(page, served):
    """When the server has been away, with what there is then."""
    page.wait_for_selector("#cards li")
    choose(page, "/a")
    drawn(page, 12)
    served.stop()
    until(page, "document.getElementById('lost').textContent.includes('Connection lost')")
    served.fleet = Fleet()
    feed(served.fleet, "/a", 30, 8.0, Level.POSITIVE, length=LENGTH)
    served.start()
    drawn(page, 30)
    assert text(page, "#lost") == ""
    assert page.locator("#choice option").count() == 1


def test_it_is_usable_without_a_mouse_or_without_eyes(page, served):
    """axe-core finds trifles at most, in overview and machine; nothing is wider than the window."""
    Axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe
    page.wait_for_selector("#cards li")
    for _ in range(2):
        found = Axe().run(page).response["violations"]
        told = {v["id"]: [n["html"] for n in v["nodes"]] for v in found if v["impact"] in SERIOUS}
        assert told == {}
        assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
        if not page.locator("#one").is_visible():
            page.focus("#cards li:first-child a")
            page.keyboard.press("Enter")
            drawn(page, 13)


def test_a_fast_machine_does_not_swamp_the_page(page, served):
    """The newest is drawn while 100 experiments a second come; what lies between is skipped."""
    page.wait_for_selector("#cards li")
    choose(page, "/a")
    drawn(page, 12)
    for number in range(13, 213):
        feed(served.fleet, "/a", number, 1.0, length=LENGTH)
        time.sleep(0.01)
    drawn(page, 212)
    assert page.locator("#choice option").count() == 200
    assert re.match(r"212\b", page.locator("#choice option").first.inner_text())


def test_an_experiment_of_one_sample_and_one_of_equal_values_are_drawn(page, served):
    """An axis has some width all the same."""
    page.wait_for_selector("#cards li")
    choose(page, "/a")
    still = np.zeros(50)
    for number, voltage in ((13, still[:1]), (14, still)):
        one = Experiment(number, 1.8e9 + number, 0.01, voltage, voltage)
        served.fleet.feed("/a", "experiment", one)
        drawn(page, number)


def test_the_only_machine_is_shown_at_once_though_it_comes_late(page, served):
    """A page may be open before its graph; a second machine does not take the view away."""
    served.stop()
    served.fleet = Fleet(clock=lambda: 0.0)
    served.start()
    page.goto("about:blank")
    page.goto(served.url)
    until(page, "document.getElementById('none').textContent.includes('No machine yet')")
    feed(served.fleet, "/late", 1, length=LENGTH)
    drawn(page, 1)
    feed(served.fleet, "/later", 1, 9.0, Level.POSITIVE, length=LENGTH)
    page.wait_for_selector("#back a")
    assert text(page, "#one-title") == "late"
