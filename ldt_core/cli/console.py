"""Rich's console for texts of any origin (`ldt_core.base.printable`); colours are its own."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import rich.console
from rich.console import ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Table

from ldt_core.base.printable import printable

WIDTH = 110  # characters of a wide table in a file or pipe

NARROWEST = 40  # characters in which a run's table still has all its figures

USUAL = 80  # characters of a terminal, in which the longest name of an effect has room


class Console(rich.console.Console):
    """Prints tables, sentences and progress; square brackets are no markup."""

    def __init__(self, wide: bool = False, **options: Any) -> None:
        super().__init__(**{"markup": False, "highlight": False, "soft_wrap": True, **options})
        if wide and not self.is_terminal:
            self.width = WIDTH
        # Whatever the terminal claims: cells of no width would leave an empty table.
        self.width = max(self.width, NARROWEST)

    def print_folded(self, table: Table, *whole: str) -> None:
        """Print a table of which nothing is cut off.

        Args:
            table: whose cells are folded where they have no room.
            whole: headers of columns that are not, as long as the terminal is of the usual width.
        """
        for column in table.columns:
            column.overflow = "fold"
            column.no_wrap = column.header in whole and self.width >= USUAL
        self.print(table, soft_wrap=False)

    def on_broken_pipe(self) -> None:
        """Whoever reads has left: raised, as by all other output; Rich would end the program."""
        raise BrokenPipeError

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Segments of text without anything that the terminal would obey."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=printable(segment.text))
