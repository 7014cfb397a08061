"""`ldt report` as a user meets it, and its page in a browser."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path

import pytest

from ldt_core.cli import invoke
from ldt_core.cli.report import command
from ldt_core.views.report.report_page import read_run

SAMPLE = Path(__file__).resolve().parents[2] / "bags" / "rotor_drift"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
PATIENCE = 120  # s for a browser on a busy machine

# What a person does, and what the page then says. Times are in s of the experiment of 20 s.
DRIVER = """
const out = {}, at = (id) => document.getElementById(id);
const wait = () => new Promise((done) => setTimeout(done, 150));
const key = (name, where) => at(where).dispatchEvent(new KeyboardEvent("keydown", { key: name }));
const seconds = () => parseFloat(at("read").textContent);
addEventListener("load", async () => {
  await wait();
  out.canvases = document.querySelectorAll("canvas").length;
  out.first = at("told").textContent;
  at("better").click();
  out.second = at("told").textContent;
  at("number").value = "12"; at("number").dispatchEvent(new Event("change"));
  out.twelfth = at("told").textContent;
  location.hash = "#experiment-5"; await wait();
  out.fifth = at("told").textContent;
  key("ArrowRight", "experiment-plots"); out.begin = seconds(); await wait();
  key("ArrowRight", "experiment-plots"); out.next = seconds(); await wait();
  out.shown = [...document.querySelectorAll("#experiment output")].map((o) => o.textContent);
  const over = document.querySelector("[data-plot=speed] .u-over");
  const box = over.getBoundingClientRect();
  const mouse = (type, share) => over.dispatchEvent(new MouseEvent(type, { bubbles: true,
    button: 0, movementX: 5, clientX: box.left + share * box.width, clientY: box.top + 40,
    view: window }));
  mouse("mouseenter", 0.5); mouse("mousemove", 0.5); mouse("mousedown", 0.5); await wait();
  mouse("mousemove", 0.6); mouse("mousemove", 0.75); await wait();
  mouse("mouseup", 0.75); await wait();
  mouse("mousemove", 0.01); await wait();
  key("ArrowRight", "experiment-plots");
  out.zoomed = seconds();
  key("0", "experiment-plots"); await wait();
  mouse("mousemove", 0.01); await wait();
  key("ArrowRight", "experiment-plots");
  out.whole = seconds();
  for (const name of ["ArrowRight", "ArrowRight", "Enter"]) key(name, "course-plots");
  out.entered = at("told").textContent;
  document.querySelector("[data-key=error] input").click(); await wait();
  out.hidden = document.querySelector("[data-key=error] input").checked;
  out.wide = document.documentElement.scrollWidth - innerWidth;
  parent.postMessage(JSON.stringify(out), "*");
});
"""
# A window is never as narrow as a phone; a frame in it can be.
FRAME = """<!doctype html><pre id="result"></pre>
<iframe src="run.html" width="{}" height="850"></iframe>
<script>onmessage = (event) => {{ document.querySelector("pre").textContent = event.data; }};
</script>"""


def test_the_command_writes_one_page(tmp_path, capsys):
    """And says where, or as JSON what is in it; an earlier one is replaced by --force alone."""
    file = tmp_path / "run.html"
    assert invoke(command, [str(SAMPLE), "-o", str(file)]) == 0
    assert capsys.readouterr().out == f"{file}\n"
    assert list(tmp_path.iterdir()) == [file]
    assert invoke(command, [str(SAMPLE), "--out", str(file)]) == 2
    assert "--force" in capsys.readouterr().err
    assert invoke(command, [str(SAMPLE), "--out", str(file), "--force", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["bytes"] == file.stat().st_size
    assert (told["experiments"], told["positives"], told["adaptations"]) == (40, 29, 22)


@pytest.mark.parametrize(
    ("recording", "out", "words"),
    [
        ("no_such_bag", "run.html", "no_such_bag: expected a recording"),
        (str(SAMPLE), "run.pdf", "out: expected a file ending in .html or .htm, got run.pdf"),
        (str(SAMPLE), "no/run.html", "out: expected a file in a folder that exists"),
    ],
)
def test_what_cannot_be_done_is_one_sentence(
    recording, out, words, tmp_path, monkeypatch, one_sentence
):
    """With exit code 2, and no file."""
    monkeypatch.chdir(tmp_path)
    assert invoke(command, [recording, "-o", out]) == 2
    assert words in one_sentence()
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module", params=[1400, 390])
def driven(request, tmp_path_factory) -> dict:
    """What the page of the sample recording said in a browser at this width."""
    browser = next((b for b in BROWSERS if shutil.which(b)), None)
    if browser is None:
        pytest.skip("no Chromium is installed")
    folder = tmp_path_factory.mktemp("browser")
    file = folder / "run.html"
    assert invoke(command, [str(SAMPLE), "-o", str(file)]) == 0
    text = file.read_text(encoding="utf-8")
    # The page's policy would refuse a script of ours as well.
    text = re.sub(r"; script-src[^\"]*", "; script-src 'unsafe-inline'", text, count=1)
    file.write_text(text.replace("</body>", f"<script>{DRIVER}</script></body>"), encoding="utf-8")
    frame = folder / "frame.html"
    frame.write_text(FRAME.format(request.param))
    done = subprocess.run(
        [
            browser,
            "--headless=new",
            "--no-sandbox",
            "--disable-gpu",
            f"--user-data-dir={folder / 'profile'}",
            "--window-size=1500,900",
            "--virtual-time-budget=10000",
            "--dump-dom",
            frame.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    found = re.search(r'<pre id="result">(.+?)</pre>', done.stdout, re.S)
    assert found, done.stderr[-2000:]
    return json.loads(unescape(found[1]))


def test_an_experiment_is_chosen_worst_first_by_number_and_by_link(driven):
    """Six plots, and words for each choice."""
    run = read_run(SAMPLE)
    worst = [run.steps[i].number for i in run.worst_first]
    assert driven["canvases"] == 6
    assert driven["first"].startswith(f"Experiment {worst[0]}: error")
    assert "(number 1 of 40, worst first)" in driven["first"]
    assert driven["second"].startswith(f"Experiment {worst[1]}: error")
    assert driven["twelfth"].startswith("Experiment 12: error")
    assert "Adaptor: new model; version 2 learned from 1 experiment" in driven["twelfth"]
    assert driven["fifth"].startswith("Experiment 5: error")


def test_plots_are_read_and_zoomed_by_keyboard_and_mouse(driven):
    """Arrows go from sample to sample, a drag zooms, Enter chooses, a box hides a curve."""
    assert (driven["begin"], driven["next"]) == (0.0, 0.01)
    assert all(driven["shown"])
    assert 9.5 < driven["zoomed"] < 10.5
    assert driven["whole"] < 0.5
    assert driven["entered"].startswith("Experiment 2: error")
    assert driven["hidden"] is False


def test_nothing_is_wider_than_the_window(driven):
    """On a phone as well."""
    assert driven["wide"] <= 0
