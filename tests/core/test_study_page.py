"""The page of a study and its figures: complete, self-contained, safe, and never without a word."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest
from fake_study import fake_study
from page_elements import BESIDE, Elements, colours_follow_the_scheme, needs_nothing_else

from ldt_core.base.errors import LdtError
from ldt_core.lab.study.figures import FIGURES, drawings
from ldt_core.lab.study.sections.summary import what_was_run
from ldt_core.lab.study.study import Evidence, Study
from ldt_core.lab.study.study_page import lead, write_figures, write_study_page
from ldt_core.views.page import style

pytestmark = pytest.mark.slow

HOSTILE = "</code><script>alert(1)</script>\"' $x^2 & {{ 7*7 }}.yaml"
LARGEST = 5_000_000  # bytes of a page


@pytest.fixture(scope="module")
def study():
    return fake_study(seeds=2, experiments=42)


@pytest.fixture(scope="module")
def page(study, tmp_path_factory):
    return write_study_page(study, tmp_path_factory.mktemp("page")).read_text(encoding="utf-8")


@pytest.fixture
def undrawn(monkeypatch):
    """Names of the figures whose drawing, which is slow, is left out."""
    names = set(FIGURES)

    def draw(drawing, layout):
        return "<svg></svg>" if drawing.name in names else style.inline_svg(drawing, layout)

    monkeypatch.setattr("ldt_core.views.page.blocks.inline_svg", draw)
    return names


def test_streams_without_wear_do_not_count_among_those_that_wear(study):
    """The machine in control is run on more streams; and two of the others decide little."""
    far = next(e for e in study.entries if e.groups == ("control",))
    case = replace(far.result.case, seed=19)
    more = replace(far, result=replace(far.result, case=case))
    wider = replace(study, entries=(*study.entries, more))
    assert "examined on 2 random streams of" in lead(wider)
    assert lead(wider).endswith("too few to decide much: this is a trial.")
    assert dict(what_was_run(Evidence(wider)))["seeds"] == "2 (0 to 1)"


def only(study: Study, *groups: str) -> Study:
    """The runs of some groups alone."""
    kept = tuple(replace(e, groups=g) for e in study.entries if (g := both(e.groups, groups)))
    return replace(study, entries=kept)


def named(study: Study, detector: str) -> Study:
    """The same with another name for the adequacy detector."""

    def renamed(entry):
        case = entry.result.case
        if case.detector != "adequacy":
            return entry
        return replace(entry, result=replace(entry.result, case=replace(case, detector=detector)))

    return replace(study, entries=tuple(map(renamed, study.entries)))


def both(first: tuple[str, ...], second: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(g for g in first if g in second)


def test_the_page_needs_nothing_else(page):
    """No script, no address to load from; links go to the page itself or to files beside it."""
    elements = needs_nothing_else(page, BESIDE)
    assert not elements.scripts
    assert len(page.encode()) < LARGEST
    # Two inlined drawings never refer to each other's parts.
    targets = re.findall(r"(?:url\(#|href=\"#)([^)\"]+)", page)
    assert set(targets) <= {a.get("id") for _, a in elements.tags}


def test_every_figure_is_on_the_page_in_both_layouts(page, study):
    """Wide and narrow, with a caption and words for those who cannot see it."""
    figures = [a for t, a in Elements(page).tags if t == "figure"]
    first = "over_stream"  # beside the answer
    assert [a["id"] for a in figures] == [first, *(n for n in FIGURES if n != first)]
    assert all(a["aria-label"] for a in figures)
    pictures = re.findall(r'<div class="(wide|narrow)" role="img"', page)
    assert pictures == ["wide", "narrow"] * len(FIGURES)


def test_no_mark_up_of_formulas_shows(page):
    """What matplotlib would have set as a formula is not left over as its source."""
    text = Elements(page).text
    assert "mathdefault" not in text
    assert "$" not in text


def test_drawings_follow_the_readers_scheme(page):
    """No fixed colour in an inlined drawing, and every variable has a dark value too."""
    colours_follow_the_scheme(page)
    light, _, dark = (set(re.findall(r"(--\w+):", part)) for part in page.split("@media", 3)[:3])
    assert set(style.VARIABLES.values()) <= light & dark


def test_the_papers_figures_stand_beside_ours(page):
    """Table 1, theirs and ours."""
    text = Elements(page).text
    for printed in ("8.86", "6.86", "10.09", "44", "25", "0.06", "0.12", "0.33"):
        assert printed in text


def test_verdicts_have_a_word_and_a_shape(page):
    """Colour alone tells nothing."""
    verdicts = re.findall(r'<span class="verdict (\w+)"><svg.*?</svg>([^<]+)</span>', page)
    assert len(verdicts) > 20
    assert verdicts[0] == ("good", "learning helps")
    assert {w for t, w in verdicts[1:] if t == "good"} <= {"confirmed", "met"}
    assert {w for t, w in verdicts if t == "bad"} <= {"not confirmed", "missed"}


def test_what_comes_from_outside_is_escaped(tmp_path, undrawn):
    """A machine's name, a detector and a note are text, whatever is in them."""
    undrawn.discard("shares")
    whole = fake_study(2, 28, machine=HOSTILE, notes=(HOSTILE,))
    study = only(named(whole, HOSTILE), "paper", "better")
    page = write_study_page(study, tmp_path).read_text(encoding="utf-8")
    elements = Elements(page)
    assert "script" not in {t for t, _ in elements.tags}
    assert elements.text.count(HOSTILE) >= 2  # machine and note; a detector has its label
    assert style.look(HOSTILE).label in elements.text
    assert "49.yaml" not in page


@pytest.mark.parametrize(
    "groups", [(), ("paper",), ("sweep",), ("better",), ("kinds",), ("control",)]
)
def test_a_small_study_says_what_is_missing(study, groups, tmp_path, undrawn):
    """A section without runs has a sentence in the place of its figures."""
    part = only(study, *groups)
    page = write_study_page(part, tmp_path).read_text(encoding="utf-8")
    drawn = [n for n, d in drawings(Evidence(part)).items() if d]
    shown = [a["id"] for t, a in Elements(page).tags if t == "figure"]
    assert sorted(shown) == sorted(drawn)
    assert page.count('class="missing"') >= len(FIGURES) - len(drawn)


def test_the_answer_stands_first_with_its_picture(page, tmp_path, undrawn):
    """Whether learning helps; of one stream that is not decided, and without runs not said."""
    assert page.index("The best of 3 learners, the diagnosed model with") < page.index("<nav")
    assert page.index('<figure id="over_stream"') < page.index("<nav")
    assert 'class="answer good"' in page
    assert "mean over 2 streams, 95 % interval" in page
    one = fake_study(1, 28)
    robust = write_study_page(only(one), tmp_path).read_text(encoding="utf-8")
    assert robust.index("The default met every aim") < robust.index("<nav")
    for study, first in ((one, "over_stream"), (only(one, "paper"), "shares")):
        text = write_study_page(study, tmp_path).read_text(encoding="utf-8")
        assert "too few streams to decide" in text
        assert "on one stream, too few for an interval" in text
        assert "1 seeds" not in text
        assert text.index(f'<figure id="{first}"') < text.index("<nav")
    nothing = write_study_page(replace(only(one), robust=()), tmp_path).read_text(encoding="utf-8")
    assert 'class="answer' not in nothing


def test_one_seed_is_enough(tmp_path, undrawn):
    """Means without an interval are shown as such."""
    undrawn.discard("thresholds")
    study = only(fake_study(1, 28), "paper", "sweep")
    assert "one seed" in write_study_page(study, tmp_path).read_text(encoding="utf-8")


def test_captions_have_the_figures_of_this_study(study):
    """Twice the error of the hybrid model, twice the figure in the words."""

    def doubled(entry):
        result = entry.result
        if result.case.model != "hybrid":
            return entry
        return replace(entry, result=replace(result, max_error=[2 * e for e in result.max_error]))

    other = replace(study, entries=tuple(map(doubled, study.entries)))
    one, two = (drawings(Evidence(s)) for s in (study, other))
    for name in ("mme_by_level", "thresholds", "over_stream"):
        assert one[name].caption != two[name].caption


def test_files_of_the_figures_are_written_and_readable(study, tmp_path, monkeypatch):
    """PNG and SVG of each; no letter below 9 points."""
    some = ("sommerfeld", "thresholds", "shares")
    monkeypatch.setattr("ldt_core.lab.study.figures.FIGURES", {n: FIGURES[n] for n in some})
    files = write_figures(study, tmp_path)
    assert {f.name for f in files} == {f"{n}.{k}" for n in some for k in ("png", "svg")}
    assert {f.parent for f in files} == {tmp_path / "figures"}
    for file in files:
        if file.suffix == ".svg":
            tree = ElementTree.parse(file)
            view = [float(v) for v in tree.getroot().get("viewBox").split()]
            assert view[2] <= 1.02 * 600  # points: 800 pixels
            sizes = {float(v) for v in re.findall(r"font-size: ([\d.]+)px", file.read_text())}
            index = 0.7 * style.FONT  # of θ_c and θ_d
            assert sizes
            assert min(sizes - {index}) >= 9
        else:
            assert file.read_bytes().startswith(b"\x89PNG")


def test_what_learns_looks_the_same_everywhere():
    """Models differ in colour, line and marker; so do detectors."""
    for names in (("measured", "original", "linear", "hybrid", "diagnosed"),):
        looks = [style.LOOKS[n] for n in names]
        assert len({x.color for x in looks}) == len(looks)
        assert len({x.marker for x in looks}) == len(looks)
    lines = [str(style.LOOKS[n].line) for n in ("original", "linear", "hybrid", "diagnosed")]
    assert len(set(lines)) == len(lines)


def test_without_matplotlib_it_is_said_at_once(monkeypatch, study, tmp_path):
    """One sentence that says what to install."""
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(LdtError, match="pip install 'ldt\\[plot\\]'"):
        write_study_page(study, tmp_path)
    assert not list(Path(tmp_path).iterdir())
