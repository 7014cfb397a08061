"""Rich's console, whose texts are printable (`ldt_core.base.printable`); colours are its own."""

from __future__ import annotations

from collections.abc import Iterable

import rich.console
from rich.console import ConsoleOptions, RenderableType
from rich.segment import Segment

from ldt_core.base.printable import printable


class Console(rich.console.Console):
    """Prints tables, sentences and progress."""

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Segments of text without anything that the terminal would obey."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=printable(segment.text))
