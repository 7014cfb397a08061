"""Draw the README's pictures anew, by the commands that they show: `python -m tests.pictures`.

Names after it draw these alone: `python -m tests.pictures watch.png`. Chromium, which Playwright
drives, photographs the three pages. Not here: pictures of a study, of the sealed cases and of
measured machines, which take hours or data that are not part of LDT; `ldt docs` has their commands.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import ViewportSize

FIGURES = Path(__file__).resolve().parents[1] / "bags" / "figures"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
WIDE = {"width": 1280, "height": 900}  # the history stands beside the experiment
TILE = {"width": 900, "height": 860}  # can be read in half a page's width
PATIENCE = 60_000  # ms
RUN = ("--experiments", "40", "--seed", "3", "--out", "my_run")  # the README's first command


def ldt(*arguments: str) -> None:
    """Run a command in the folder of the pictures."""
    if not (arguments[0] == "up" and Path("my_run").exists()):
        subprocess.run(["ldt", *arguments], check=True)


def learns() -> None:
    """Experiments and errors of the first command."""
    ldt("up", *RUN)
    ldt("plot", "my_run", "--out", "rotor_run.png")


def report() -> None:
    """The page of the same run."""
    ldt("up", *RUN)
    ldt("report", "my_run", "-o", "my_run.html")
    photograph(Path("my_run.html").resolve().as_uri(), "run_report.png", "canvas", TILE)


def says_why() -> None:
    """The rotor of `ldt docs diagnosis`, with more experiments."""
    effect = ("--effect", "unbalance:e=0.005", "--seed", "3")
    ldt("simulate", "--machine", "rotor", "--experiments", "12", *effect, "--out", "unbalanced")
    diagnosis = ("--out", "diagnosis", "--figure", "diagnosis.png")
    ldt("diagnose", "unbalanced", "--machine", "rotor", *diagnosis)


def answers() -> None:
    """The first view of the same diagnosis' page."""
    if not Path("diagnosis").exists():
        says_why()
    page = Path("diagnosis/diagnosis.html").resolve().as_uri()
    photograph(page, "diagnosis_page.png", "footer", TILE)


def advises() -> None:
    """The picture of `ldt docs advice`."""
    worn = ("--machine", "rotor", "--effect", "unbalance:e=0.01")
    ldt("advise", *worn, "--reach", "40", "--out", "advice.png")


def watches() -> None:
    """The same run, played back in the browser to its end."""
    ldt("up", *RUN)
    with served("my_run") as address:
        photograph(address, "watch.png", "body[data-drawn^='40:']", WIDE)


@contextmanager
def served(bag: str) -> Iterator[str]:
    """The address at which `ldt watch` shows a recording."""
    watch = ["ldt", "watch", bag, "--rate", "1000", "--port", "0"]
    with subprocess.Popen(watch, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield re.search(r"http://\S+", process.stdout.readline())[0]
        finally:
            process.terminate()


def photograph(address: str, picture: str, ready: str, size: ViewportSize) -> None:
    """A page's first view, once an element that it ends with is there."""
    from playwright.sync_api import sync_playwright

    program = next(b for b in map(shutil.which, BROWSERS) if b)
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=["--no-sandbox"])
        page = browser.new_page(viewport=size, color_scheme="light")
        page.goto(address)
        page.wait_for_selector(ready, timeout=PATIENCE)
        page.wait_for_timeout(1000)  # ms; what is drawn last
        page.screenshot(path=picture)
        browser.close()


PICTURES: dict[str, Callable[[], None]] = {
    "rotor_run.png": learns,
    "run_report.png": report,
    "diagnosis.png": says_why,
    "diagnosis_page.png": answers,
    "advice.png": advises,
    "watch.png": watches,
}


def main(names: list[str]) -> None:
    """Draw the pictures of these names, or all."""
    for name in names or PICTURES:
        with tempfile.TemporaryDirectory() as folder:  # two of them begin with the same command
            os.chdir(folder)
            PICTURES[name]()
            shutil.copy(name, FIGURES / name)


if __name__ == "__main__":
    main(sys.argv[1:])
