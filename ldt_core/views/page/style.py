"""How every figure of a page looks: colours, line styles, sizes, and how it becomes a file.

A model or detector has one colour, one line style and one marker wherever it appears. The colours
are those of Okabe and Ito, which colour-blind people can tell apart. In a page the same drawing
follows the reader's light or dark scheme: each colour is written as a CSS variable there.
"""

from __future__ import annotations

import io
import math
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from ldt_core.base.errors import LdtError, OptionError
from ldt_core.base.result_files import check_target, whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

INK, PAPER, FAINT, SHADE = "#1c1d1f", "#fefefe", "#d5d6d8", "#e9e4d4"
BLUE, ORANGE, GREEN, PURPLE = "#0072b2", "#e69f00", "#009e73", "#cc79a7"
VERMILION, SKY, GREY = "#d55e00", "#56b4e9", "#77787b"

#: CSS variable of each colour, declared for both schemes in `templates/style.css`.
VARIABLES = {
    INK: "--ink",
    PAPER: "--paper",
    FAINT: "--faint",
    SHADE: "--shade",
    BLUE: "--blue",
    ORANGE: "--orange",
    GREEN: "--green",
    PURPLE: "--purple",
    VERMILION: "--vermilion",
    SKY: "--sky",
    GREY: "--grey",
}

FONT = 9  # points; 12 pixels at the width in which a figure is shown
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
LONGEST = 16  # letters of a name in a label; names of users' own parts are paths
PIXELS = 96  # per inch, CSS
PNG_DPI = 144
SVG_DPI = 72  # points, as matplotlib writes it
PICTURES = (".png", ".svg", ".pdf")  # endings of a figure by itself

RC: Any = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": FONT,
    "axes.titlesize": FONT,
    "axes.titlelocation": "left",
    "axes.labelsize": FONT,
    "xtick.labelsize": FONT,
    "ytick.labelsize": FONT,
    "legend.fontsize": FONT,
    "legend.frameon": False,
    "legend.handlelength": 2.6,
    "text.color": INK,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.facecolor": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.linewidth": 0.8,
    "grid.color": FAINT,
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.6,
    "lines.markersize": 5,
    # Names come from users: a dollar in one is a dollar.
    "text.parse_math": False,
    # Text stays text: small, selectable, in the reader's font.
    "svg.fonttype": "none",
}


@dataclass(frozen=True)
class Look:
    """How one model or detector is drawn."""

    label: str
    color: str
    line: Any
    marker: str

    def plot(self, **more: Any) -> dict[str, Any]:
        """Arguments of `Axes.plot`."""
        return {"color": self.color, "ls": self.line, "label": self.label, **more}


LOOKS = {
    "measured": Look("measured", INK, "-", ""),
    "original": Look("original", ORANGE, (0, (1, 1.1)), "x"),
    "linear": Look("linear", PURPLE, (0, (5, 1.6)), "s"),
    "hybrid": Look("hybrid", BLUE, "-", "o"),
    "diagnosed": Look("diagnosed", GREEN, (0, (6, 1.5, 1.2, 1.5)), "D"),
    "threshold": Look("threshold", VERMILION, "-", "o"),
    "lddm": Look("LDDM", SKY, (0, (5, 1.6)), "^"),
    "window": Look("window", GREY, (0, (6, 1.5, 1.2, 1.5)), "s"),
    "adequacy": Look("adequacy", INK, "-", "D"),
    "never": Look("never", GREY, ":", "x"),
    "periodic": Look("periodic", GREY, ":", "|"),
    "random": Look("random", GREY, ":", "."),
}


def look(name: str) -> Look:
    """How a model or detector is drawn; one nobody knows is grey, and a long name is cut."""
    return LOOKS.get(name, Look(short(name), GREY, "-", "v"))


def short(name: str, most: int = LONGEST) -> str:
    """A name in a figure, the end of it where it is long."""
    return name if len(name) <= most else f"…{name[1 - most :]}"


def pair(model: str, detector: str) -> str:
    """A model and its detector in a label."""
    return f"{look(model).label}, {look(detector).label}"


@dataclass(frozen=True)
class Layout:
    """The room a figure has.

    Attributes:
        width: [inches].
    """

    name: str
    width: float
    narrow: bool


WIDE = Layout("wide", 800 / PIXELS, False)
NARROW = Layout("narrow", 358 / PIXELS, True)


@dataclass(frozen=True)
class Drawing:
    """A figure and its words."""

    name: str
    title: str
    caption: str
    alt: str
    draw: Callable[[Layout], Figure]


class Panels(Protocol):
    """What can be drawn into a figure or into a part of one."""

    def height(self, layout: Layout) -> float:
        """That it needs [inches]."""

    def draw(self, figure: Figure | SubFigure, layout: Layout) -> None:
        """Into an empty figure of that height."""

    def alone(self, layout: Layout) -> Figure:
        """A figure of its own."""
        figure = blank(layout, self.height(layout))
        self.draw(figure, layout)
        return figure


def require(who: str = "a study") -> None:
    """Refuse at once what would fail after hours.

    Raises:
        LdtError: matplotlib is not installed.
        OptionError: MPLBACKEND names no backend.
    """
    try:
        import matplotlib  # noqa: F401
    except ValueError:
        expected = "the name of a matplotlib backend, or nothing"
        raise OptionError("MPLBACKEND", expected, repr(os.environ.get("MPLBACKEND"))) from None
    except ImportError as error:
        raise LdtError(
            f"{who} draws with matplotlib, which is not installed: pip install 'ldt[plot]'"
        ) from error


def blank(layout: Layout, height: float) -> Figure:
    """A figure without axes, so high [inches]."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(layout.width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def panels(
    layout: Layout, height: float, columns: int = 1, count: int = 1, **more: Any
) -> tuple[Figure, list[Axes]]:
    """An empty figure and its axes, row by row.

    Args:
        height: of one row [inches].
        columns: beside each other in the wide layout, no more than there are; one in the narrow.
        more: to `Figure.subplots`.
    """
    columns = 1 if layout.narrow else min(columns, count)
    rows = -(-count // columns)
    figure = blank(layout, height * rows)
    grid = figure.subplots(rows, columns, squeeze=False, **more)
    axes = list(grid.flat)
    for spare in axes[count:]:
        spare.remove()
    return figure, axes[:count]


def legend(figure: Figure | SubFigure, axes: list[Axes], layout: Layout, columns: int = 5) -> None:
    """One legend for all axes, above them, where it covers no data."""
    entries: dict[str, Any] = {}
    for one in axes:
        handles, labels = one.get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
    if entries:
        figure.legend(
            entries.values(),
            entries.keys(),
            loc="outside upper left",
            ncols=2 if layout.narrow else columns,
        )


def power(value: float, _place: float = 0) -> str:
    """A tick of a logarithmic axis.

    >>> power(0.1), power(1.0), power(1e5)
    ('0.1', '1', '10⁵')
    """
    exponent = round(math.log10(value))
    if -3 < exponent < 4:
        return f"{value:g}"
    return "10" + str(exponent).translate(SUPERSCRIPT)


def drawn(drawing: Drawing, layout: Layout) -> Figure:
    """The figure in this layout, in the house style."""
    import matplotlib

    with matplotlib.rc_context(RC):
        return drawing.draw(layout)


def save(drawing: Drawing, folder: Path) -> list[Path]:
    """Write NAME.png and NAME.svg.

    Returns:
        The files.
    """
    import matplotlib

    files = [folder / f"{drawing.name}.png", folder / f"{drawing.name}.svg"]
    figure = drawn(drawing, WIDE)
    with matplotlib.rc_context({**RC, "svg.hashsalt": drawing.name}):
        _lay_out(figure, PNG_DPI)
        with whole(files[0], ".png") as part:
            figure.savefig(part, dpi=PNG_DPI, facecolor="white")
        with whole(files[1], ".svg") as part:
            figure.savefig(part, facecolor="white", metadata={"Date": None})
    return files


def check_picture(file: str | Path, option: str = "--out", who: str = "a picture") -> None:
    """Refuse a picture that cannot be drawn, before any work is done.

    Raises:
        OptionError: an ending that is no picture's, or a folder that does not exist.
        LdtError: matplotlib is not installed.
    """
    check_target(file, option, PICTURES)
    require(who)


def picture(
    width: float, height: float, draw: Callable[[Figure], None], who: str = "a picture"
) -> Figure:
    """A figure that stands by itself, in the house style."""
    require(who)
    import matplotlib

    with matplotlib.rc_context(RC):
        figure = blank(Layout("picture", width, False), height)
        draw(figure)
    return figure


def save_picture(figure: Figure, file: str | Path) -> None:
    """Write it as .png, .svg or .pdf, the same bytes each time."""
    import matplotlib

    metadata = {"Date": None} if str(file).endswith("svg") else None
    path = Path(file)
    salted = matplotlib.rc_context({**RC, "svg.hashsalt": path.name})
    with whole(path, path.suffix) as part, salted:
        _lay_out(figure, PNG_DPI)
        figure.savefig(part, dpi=PNG_DPI, facecolor="white", metadata=metadata)


def _lay_out(figure: Figure, dpi: float) -> None:
    """Place the axes once: `savefig` would do so twice, and draw all of it twice for that."""
    figure.set_dpi(dpi)
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine(None)


def inline_svg(drawing: Drawing, layout: Layout) -> str:
    """The figure as an SVG element for a page that holds many.

    Colours are CSS variables, the size is the page's, identifiers are the figure's own.
    """
    import matplotlib

    figure = drawn(drawing, layout)
    file = io.StringIO()
    own = f"{drawing.name}-{layout.name}"
    with matplotlib.rc_context({**RC, "svg.hashsalt": own}):
        _lay_out(figure, SVG_DPI)
        figure.savefig(file, format="svg", transparent=True, metadata={"Date": None})
    svg = file.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r' (width|height)="[\d.]+pt"', "", svg, count=2)
    svg = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{own}-", svg)
    svg = svg.replace("<svg ", '<svg aria-hidden="true" focusable="false" ', 1)
    for color, variable in VARIABLES.items():
        svg = re.sub(color, f"var({variable})", svg, flags=re.IGNORECASE)
    return svg
