"""The page of a diagnosis: complete, self-contained, safe, and true to its numbers."""

from __future__ import annotations

import itertools
import math
import re
import sys
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from fake_diagnosis import TRUTH, fake_diagnosis
from hypothesis import given
from hypothesis import strategies as st
from matplotlib import rc_context
from page_elements import Elements, colours_follow_the_scheme, needs_nothing_else

from ldt_core.base.errors import LdtError
from ldt_core.cli.diagnose import _print as shown_on_terminal
from ldt_core.diagnosis.diagnosis import (
    Gap,
    GapLocation,
    HeldOutErrors,
    ParameterAmount,
    Refit,
)
from ldt_core.diagnosis.recorded_units import FITS
from ldt_core.views.diagnosis_page import diagnosis_page, diagnosis_sections
from ldt_core.views.diagnosis_page.diagnosis_page import picture
from ldt_core.views.diagnosis_page.headline import WORDS, headline
from ldt_core.views.diagnosis_page.next_step import next_step
from ldt_core.views.diagnosis_page.number_format import amount, percent, value_of
from ldt_core.views.diagnosis_page.signal_curves import binned, orders, spectrum
from ldt_core.views.diagnosis_page.time_curves import corners, shown_free_runs
from ldt_core.views.packed_samples import thinned
from ldt_core.views.page import style

pytestmark = pytest.mark.slow

LARGEST = 2_000_000  # bytes of a page
HOSTILE = "<b>x</b>\"' $y^2$ {{ 7*7 }}"
FIGURES = ["curves", "places", "bars"]


def written(diagnosis, folder):
    (folder / "page.html").write_text(diagnosis_page.page(diagnosis), encoding="utf-8")
    return (folder / "page.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def diagnoses():
    return {kind: fake_diagnosis(kind, 5) for kind in TRUTH}


@pytest.fixture(scope="module", params=list(TRUTH))
def kind(request):
    return request.param


@pytest.fixture(scope="module")
def page(kind, diagnoses, tmp_path_factory):
    return written(diagnoses[kind], tmp_path_factory.mktemp("page"))


def test_the_answer_comes_first(page, kind, diagnoses):
    """Verdict, a short sentence, confidence and the curves under the title; then all of it."""
    verdict = diagnoses[kind].verdict
    head, body = unescape(page).split("<nav")
    assert f"</svg>{WORDS[verdict.kind]}</span>" in head
    assert "confidence\N{NO-BREAK SPACE}97\N{NO-BREAK SPACE}%" in head
    assert (", before and after" in head) == (kind not in ("none", "unknown"))
    short = headline(diagnoses[kind])
    assert short in head
    assert len(short.split()) <= 26
    assert '<figure id="curves"' in head
    assert verdict.sentence in body


def test_the_short_sentence_names_cause_amount_and_what_it_closes(diagnoses):
    """Of one effect, of two, of a group; none of what is unknown, all of a sensor's fault."""
    assert headline(diagnoses["effect"]).startswith("Unbalance, 4.9 ± 0.3 mm, closes 99 % of")
    assert " rad/s)." in headline(diagnoses["effect"])
    assert " and gravity imbalance (0." in headline(diagnoses["pair"])
    assert " close " in headline(diagnoses["pair"])
    assert headline(diagnoses["ambiguous"]).startswith(
        "Viscous friction, motor constant or source resistance closes"
    )
    unknown = diagnoses["unknown"]
    assert headline(unknown).startswith("No known cause explains the gap of ")
    late = GapLocation("experiment", 5.0, 8.0, "", 0.71, 0.5)
    assert headline(replace(unknown, where=(late,))).endswith(
        f"; {percent(0.71)} of it lies in experiments 5 to 8."
    )
    none = diagnoses["none"]
    assert headline(none).startswith("No gap: ")
    closing = Refit("J", 1.1, None, 0.05, 0.97)
    assert ", nominal parameters close 97 %, and no" in headline(replace(unknown, refit=[closing]))
    known, other = (
        replace(closing, parameter=n, ci95=ends)
        for n, ends in (("R", (0.9, 1.3)), ("L", (0.5, 0.8)))
    )
    said = headline(replace(unknown, refit=[closing, known, other]))
    assert ", nominal parameters (L × 1.1) close 97 %, and no" in said
    assert headline(replace(none, refit=[closing])).startswith("No effect is needed: the file's ")
    told = diagnosis_sections.answer(replace(none, refit=[closing]), Path("diagnosis.json"))
    assert told.mark.word == "no effect needed"
    assert "ldt calibrate" in told.command
    verdict = replace(unknown.verdict, sentence="Sensor fault: it sticks.")
    assert headline(replace(unknown, verdict=verdict)) == "Sensor fault: it sticks."


def test_several_causes_of_which_some_stay_open_are_told_apart_in_the_sentence(diagnoses):
    """Groups stand between semicolons, a factor is "times", and no comma stands twice."""
    found = diagnoses["pair"]
    first = next(c for c in found.candidates if c.effect == "coulomb_friction")
    resistance = replace(
        first,
        effect="armature_resistance",
        parameters={"factor": ParameterAmount(1.6, "", (1.5, 1.7))},
    )
    added = {"effect": "armature_resistance", "parameters": {"factor": 1.6}}
    along = {"effect": "inertia", "parameters": {"factor": 0.4968}}
    verdict = replace(
        found.verdict,
        kind="ambiguous",
        acting=[["armature_resistance"], ["viscous_asymmetric", "viscous_friction", "inertia"]],
    )
    found = replace(
        found,
        candidates=[resistance, *found.candidates],
        effects=[added, along],
        verdict=verdict,
    )
    assert headline(found).startswith(
        "Armature resistance (1.6 ± 0.1 times); viscous asymmetric, viscous friction or inertia: "
        "together they close "
    )
    pairs = dict(
        pair
        for block in diagnosis_sections.gap(found, Path("diagnosis.json")).blocks
        for pair in getattr(block, "pairs", ())
    )
    assert pairs["fitted along"] == "inertia: factor = 0.497"
    assert pairs["effect added"].startswith("armature_resistance: factor = 1.60")


def test_the_page_needs_nothing_else(page):
    """No script, no address to load from, small; drawings have no colour of their own."""
    assert not needs_nothing_else(page).scripts
    assert len(page.encode()) < LARGEST
    colours_follow_the_scheme(page)


def test_every_figure_has_both_layouts_and_words(page, kind):
    """Wide and narrow, and a description for those who cannot see it."""
    expected = [f for f in FIGURES if (f, kind) != ("bars", "none")]
    expected += ["parts"] if kind == "pair" else []
    expected += ["voltage"] if kind in ("ambiguous", "unknown") else []
    figures = [a for t, a in Elements(page).tags if t == "figure"]
    assert [a["id"] for a in figures] == expected
    assert all(len(a["aria-label"]) > 20 for a in figures)
    pictures = re.findall(r'<div class="(wide|narrow)" role="img"', page)
    assert pictures == ["wide", "narrow"] * len(expected)


def test_nothing_undefined_shows(page):
    """No nan, None or inf, neither in words nor in a path."""
    assert not re.search(r"\b(nan|NaN|None|inf|Infinity)\b", page.partition("</style>")[2])


def test_numbers_are_those_of_the_diagnosis(page, kind, diagnoses):
    """Errors before and after, the closed fraction, amounts and the held-out experiments."""
    found, text = diagnoses[kind], Elements(page).text
    for value in (found.gap.before.rmse, found.gap.after.mean_max_error):
        assert value_of(value) in text
    if kind == "none":
        assert "no gap beyond the noise" in text
    else:
        assert percent(found.gap.closed_fraction) in text
    for candidate in found.candidates:
        assert candidate.effect in text
        for name, one in candidate.parameters.items():
            assert amount(name, one)[0] in text
    assert "3 (1)" in text


def test_what_the_verdict_names_is_marked_and_nothing_else(page, kind, diagnoses):
    """A row a candidate: it acts, may act, or has a reason why not."""
    named = diagnoses[kind].verdict.effects
    acting = {"effect": "acts", "pair": "acts", "ambiguous": "may act"}.get(kind, "")
    rows = re.findall(r'<tr><th scope="row">(\w+) <span.*?</tr>', page, flags=re.DOTALL)
    marked = re.findall(
        r'<tr><th scope="row">(\w+) <span class="small">[^<]*</span></th><td><span class="verdict '
        r'\w+"><svg.*?</svg>([\w ]+)</span>',
        page,
    )
    assert len(rows) == len(diagnoses[kind].candidates)
    assert marked == [(name, acting) for name in named]


def test_regimes_say_where_it_got_worse(diagnoses, tmp_path, undrawn):
    """A regime whose closed fraction is below 0 is marked."""
    page = written(diagnoses["effect"], tmp_path)
    assert page.count("</svg>worse</span>") == 1
    assert "In 1 of 3 the error grew." in page


def test_what_comes_from_outside_is_text(diagnoses, tmp_path):
    """An effect, a machine, a recording and a sentence that are mark-up are shown as such."""
    found = diagnoses["ambiguous"]
    first = replace(found.candidates[0], effect=HOSTILE, rejected_because=HOSTILE)
    verdict = replace(
        found.verdict, effects=[HOSTILE, "inertia"], acting=[[HOSTILE]], sentence=HOSTILE
    )
    hostile = replace(
        found,
        machine=HOSTILE,
        recordings=[HOSTILE],
        verdict=verdict,
        candidates=[first, *found.candidates[1:]],
        undetectable=[HOSTILE],
        ambiguities=[[HOSTILE, "inertia"]],
        notes=[HOSTILE],
        effects=[{"effect": HOSTILE, "parameters": {}}],
    )
    page = written(hostile, tmp_path)
    elements = Elements(page)
    # Only the page's own: captions of the figures and the names in lists are bold.
    assert "<b>x" not in page
    assert elements.text.count(HOSTILE) >= 8
    assert "49" not in re.findall(r"\$ \S+ 7\*7 \S+|\$ 49", page)


def test_a_diagnosis_with_next_to_nothing_is_a_page_as_well(diagnoses, tmp_path):
    """No experiment, no candidate, no number: sentences in their places."""
    least = replace(
        diagnoses["none"],
        recordings=[],
        experiments={},
        gap=Gap(
            0.1, HeldOutErrors(math.nan, math.nan), HeldOutErrors(math.nan, math.nan), None, None
        ),
        candidates=[],
        where=[],
        undetectable=[],
        ambiguities=[],
        notes=(),
        shown=(),
    )
    page = written(least, tmp_path)
    assert page.count('class="missing"') == 5
    assert not re.search(r"\bnan\b", page)
    with pytest.raises(LdtError, match="nothing to draw"):
        picture(least, tmp_path / "nothing.png")


def test_a_free_run_that_diverges_leaves_a_hole(diagnoses, tmp_path):
    """It is the largest error; what is not there is not drawn."""
    found = diagnoses["effect"]
    held = next(s for s in found.shown if s.held_out)
    lost = replace(held, before=np.full(len(held.experiment), math.nan))
    shown = [lost if s is held else s for s in found.shown]
    page = written(replace(found, shown=shown), tmp_path)
    assert "diverges before" in page
    assert not re.search(r"\bnan\b", page)


def test_experiments_that_are_parts_are_called_parts(diagnoses, tmp_path, undrawn):
    """A recording of one experiment is divided; the lead says so."""
    parts = replace(diagnoses["effect"], experiments={"fit": [1], "held_out": [1]})
    assert "free runs on parts of 1 experiment that" in written(parts, tmp_path)


def test_the_worst_and_a_typical_held_out_experiment_are_shown():
    """Of six held out: the one with the largest error before, and the median."""
    found = shown_free_runs(fake_diagnosis("effect", 18))
    errors = [
        float(np.sqrt(np.mean((s.experiment.speed - s.before) ** 2))) for s, _ in found.chosen
    ]
    every = fake_diagnosis("effect", 18).shown
    held = sorted(
        float(np.sqrt(np.mean((s.experiment.speed - s.before) ** 2))) for s in every if s.held_out
    )
    assert errors == [held[-1], held[2]]


def test_the_next_experiment_comes_with_commands_that_take_it(diagnoses, tmp_path, undrawn):
    """Recordings are quoted, and every channel has a column."""
    page = Elements(written(diagnoses["ambiguous"], tmp_path)).text
    assert "ldt diagnose bags/monday 'bags/tuesday evening' next --machine FILE" in page
    given = replace(diagnoses["ambiguous"], machine_file="my press.yaml")
    assert "--machine 'my press.yaml'" in Elements(written(given, tmp_path)).text
    shipped = replace(given, machine_file="rotor.yaml")
    assert "--machine rotor --out again" in Elements(written(shipped, tmp_path)).text
    assert "--voltage u --speed n --current i --sample-period 0.01 --length 20" in page


def test_the_terminal_cuts_no_name(diagnoses, tmp_path, capsys, monkeypatch):
    """In 80 columns, where the names of effects ended in an ellipsis."""
    monkeypatch.setenv("COLUMNS", "80")
    named = replace(diagnoses["ambiguous"].candidates[0], effect="armature_inductance@elbow")
    shown_on_terminal(replace(diagnoses["ambiguous"], candidates=[named]), tmp_path)
    out = capsys.readouterr().out
    assert "armature_inductance@elbow" in out
    assert "…" not in out


def test_the_terminal_says_what_the_next_experiment_is(diagnoses, tmp_path, capsys):
    """Its voltage too, not only why."""
    shown_on_terminal(diagnoses["ambiguous"], tmp_path)
    out = capsys.readouterr().out
    assert "V in steps of 1 s, 2000 samples of 0.01 s (in diagnosis.json)" in out
    assert "record voltage, speed and current" in out


def test_the_command_that_predicts_names_the_file_where_it_is(diagnoses, undrawn):
    """Recordings are named from where the command was given; so is the diagnosis."""
    page = diagnosis_page.page(diagnoses["effect"], Path("my answers/diagnosis.json"))
    assert "--with 'my answers/diagnosis.json' --out predicted" in Elements(page).text


def test_the_picture_is_one_png(diagnoses, tmp_path):
    """Before and after, and the places, for a text that has room for one."""
    picture(diagnoses["pair"], tmp_path / "pair.png")
    assert (tmp_path / "pair.png").read_bytes().startswith(b"\x89PNG")


def test_without_matplotlib_it_is_said(monkeypatch, diagnoses, tmp_path):
    """One sentence that says what to install, and no half of a page."""
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(LdtError, match="pip install 'ldt\\[plot\\]'"):
        diagnosis_page.page(diagnoses["none"])
    assert not list(tmp_path.iterdir())


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=300), st.integers(4, 80))
def test_thinning_keeps_the_extremes_and_the_ends(values, most):
    """Whatever is left out lies between what is kept."""
    y = np.array(values)
    x = np.arange(y.size, dtype=float)
    at, kept = thinned(x, y, most)
    assert (kept.min(), kept.max()) == (y.min(), y.max())
    assert (at[0], at[-1]) == (x[0], x[-1])
    assert kept.size <= most
    assert (np.diff(at) > 0).all()


def test_bins_find_the_law():
    """A straight line over a range, and the means over a few levels."""
    random = np.random.default_rng(0)
    x = random.uniform(-3, 5, 20_000)
    found = binned(x, 2 * x + random.normal(0, 0.5, x.size))
    np.testing.assert_allclose(found.mean, 2 * found.x, atol=0.15)
    np.testing.assert_allclose(found.high - found.low, 2 * 1.2816 * 0.5, atol=0.35)
    levels = binned(np.repeat([1.0, 4.0], 50), np.repeat([7.0, -2.0], 50))
    np.testing.assert_allclose([levels.x, levels.mean], [[1, 4], [7, -2]])


def test_a_spectrum_shows_a_sine_where_it_is():
    """2.5 Hz among experiments of different lengths and periods; not in one that is not finite."""
    rows, periods = [], (0.01, 0.02, 0.01)
    for period, length in zip(periods, (2000, 800, 500), strict=True):
        rows.append(np.sin(2 * math.pi * 2.5 * np.arange(length) * period))
    rows[2][3] = math.nan
    frequency, density = spectrum(rows, periods)
    assert frequency[np.argmax(density)] == pytest.approx(2.5, abs=0.06)
    assert np.isfinite(density).all()


def test_orders_follow_the_shaft_also_where_it_turns_back():
    """0.3 sin(3 theta) at speeds that vary by ten and change sign: amplitude 0.3 at order 3."""
    period = 0.005
    time = np.arange(8000) * period
    speed = 20 * np.sin(2 * math.pi * 0.05 * time) + 4
    angle = np.cumsum(speed) * period
    order, amplitude = orders([0.3 * np.sin(3 * angle)], [speed], [period])
    assert order[np.argmax(amplitude)] == pytest.approx(3.0, abs=0.051)
    assert amplitude.max() == pytest.approx(0.3, rel=0.1)
    assert np.median(amplitude) < 0.01


def test_orders_that_the_samples_cannot_show_are_left_out():
    """At 100 rad/s and 10 ms there are 6.28 samples a turn: orders up to 3."""
    speed = np.full(4000, 100.0)
    order, _ = orders([np.ones(4000)], [speed], [0.01])
    assert 3.0 < order.max() < math.pi
    assert orders([np.ones(4000)], [0 * speed], [0.01])[0].size == 0


def test_corners_of_held_levels():
    """Two levels, four corners, the last at the end."""
    time, level = corners(np.array([1.0, 1.0, -2.0]), 0.5)
    np.testing.assert_allclose(time, [0, 1, 1, 1.5])
    np.testing.assert_allclose(level, [1, 1, -2, -2])


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (math.nan, "–"),
        (0.0, "0"),
        (-0.25, "−0.250"),
        (1.234e-6, "1.23 · 10⁻⁶"),
        (9.996e-4, "0.00100"),
        (0.09996, "0.100"),
        (2.5e7, "2.50 · 10⁷"),
    ],
)
def test_numbers_keep_their_digits(value, text):
    """Three of them, with a power of ten where there would be only zeros."""
    assert value_of(value) == text


@pytest.mark.parametrize(
    ("found", "text"),
    [
        (ParameterAmount(0.0049, "m", (0.0047, 0.0051)), ("p = 4.90 mm", "4.70 to 5.10")),
        (
            ParameterAmount(0.0049991, "m", (0.0049956, 0.0050026)),
            ("p = 4.999 mm", "4.996 to 5.003"),
        ),
        (ParameterAmount(2e-5, "N m s^2", None), ("p", "not determined")),
        (
            ParameterAmount(2e-5, "N m s^2", (1e-5, 3e-5)),
            ("p = 2.00 · 10⁻⁵ N m s²", "1.00 · 10⁻⁵ to 3.00 · 10⁻⁵"),
        ),
        (ParameterAmount(0.0, "rad", (0.0, 0.0)), ("p = 0 rad", "0 to 0")),
        (ParameterAmount(0.3, "Ohm", (0.0, math.inf)), ("p = 0.300 Ω", "0 to –")),
    ],
)
def test_amounts_show_their_intervals_width(found, text):
    """As many digits as it takes, in a unit for people."""
    assert amount("p", found) == text


def test_shares():
    """Whole per cents but near 0 and 100."""
    given_ = (0.004, 0.5, 0.996, 0.9999, 1.0, -0.0001, -2.4)
    words = ["0.4 %", "50 %", "99.6 %", "100 %", "100 %", "0 %", "−240 %"]
    assert [percent(v) for v in given_] == words


def test_a_place_is_marked_in_its_panel(diagnoses):
    """One that holds all of the data marks nothing."""
    from ldt_core.views.diagnosis_page.gap_curves import gap_curves

    found = diagnoses["effect"]
    everywhere = GapLocation("voltage", 0, 20, "V", 1.0, 1.0)
    marked = gap_curves(replace(found, where=[*found.where, everywhere])).marked
    assert set(marked) == {"speed", "frequency", "experiment"}


def test_accelerations_of_thousands_do_not_run_into_each_other(diagnoses):
    """ "−2000−1500−1000−500" stood below a pump's torque."""
    from ldt_core.views.diagnosis_page.gap_curves import gap_curves

    found = gap_curves(diagnoses["effect"])
    wide = replace(found.bins["acceleration"][0], x=np.linspace(-1800, 1800, 20))
    wide = replace(wide, **dict.fromkeys(("mean", "low", "high"), np.zeros(20)))
    with rc_context(style.RC):
        figure = replace(found, bins={**found.bins, "acceleration": [wide]}).alone(style.WIDE)
        figure.draw_without_rendering()
    ticks = [t for t in figure.axes[2].get_xticklabels() if abs(t.get_position()[0]) < 2000]
    boxes = sorted((t.get_window_extent() for t in ticks), key=lambda box: box.x0)
    assert len(boxes) >= 3
    assert all(a.x1 + 5 < b.x0 for a, b in itertools.pairwise(boxes))


def test_a_gap_that_differs_between_experiments_asks_what_changed_when():
    """A twin that follows the machine diagnoses each change by itself; any other gap it learns."""
    found, kept = fake_diagnosis("unknown"), Path("diagnosis.json")
    changed = replace(found, where=[GapLocation("experiment", 5, 8, "", 0.9, 0.5)])
    steady = replace(found, where=[GapLocation("speed", 5, 8, "rad/s", 0.9, 0.5)])
    assert next_step(changed, kept)[1].endswith("--out played --diagnose")
    assert next_step(steady, kept)[1].endswith("--out played")


def test_after_a_sensor_s_fault_the_next_step_is_the_sensor(diagnoses):
    """No twin learns what has no name from a speed that was not measured."""
    for kind in ("unknown", "effect", "none"):
        told = f"{diagnoses[kind].verdict.sentence} That is by those before a sensor fault"
        verdict = replace(diagnoses[kind].verdict, sentence=told)
        words, command = next_step(replace(diagnoses[kind], verdict=verdict), Path("why.json"))
        assert words.startswith("mend the sensor")
        assert " --only NUMBERS --out " in command


def test_a_unit_that_explains_the_gap_is_mended_before_anything_is_added():
    """The import, not the machine file with a sensor's gain of 9.55."""
    found = replace(fake_diagnosis("effect"), notes=[f"check the unit: in rpm {FITS}"])
    words, command = next_step(found, Path("diagnosis.json"))
    assert words.endswith("import again")
    assert command.startswith("ldt import TABLE --speed NAME:UNIT")


def test_a_machine_file_lists_an_effect_of_a_file_before_it_is_added():
    """A diagnosis names no Python file, so `ldt calibrate --with` cannot find it."""
    found = fake_diagnosis("effect")
    named = replace(found, verdict=replace(found.verdict, effects=["cubic_drag"]))
    assert next_step(found, Path("diagnosis.json"))[0] == "add what was found to the machine file"
    words, command = next_step(named, Path("diagnosis.json"))
    assert words.startswith("write `own_effects: [FILE.py:NAME]` of cubic_drag into")
    assert "--with diagnosis.json" in command


def test_where_no_experiment_tells_causes_apart_the_first_is_added():
    """A winding and its supply: there was no next step at all."""
    found = replace(fake_diagnosis("ambiguous"), next_experiment=None)
    words, command = next_step(found, Path("diagnosis.json"))
    assert words.startswith("as no experiment tells them apart")
    assert "--with diagnosis.json" in command


@pytest.mark.parametrize("kind", ["effect", "ambiguous", "unknown", "none"])
def test_what_to_do_next_stands_with_the_answer(kind, undrawn):
    """A command, or the section with the experiment that tells causes apart; above the picture."""
    shown = diagnosis_page.page(fake_diagnosis(kind))
    step = shown.index('<p class="step">Next, ')
    assert shown.index('<p class="sentence">') < step < shown.index("<figure")
    assert ('<a href="#next">' in shown[step : step + 80]) == (kind == "ambiguous")
