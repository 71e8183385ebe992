"""Tables of measurements, for a terminal and in Markdown, and the bar while they are made."""

from collections.abc import Sequence
from dataclasses import dataclass

import rich.table
from rich import box
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

Cells = tuple[str, ...]


@dataclass(frozen=True)
class Table:
    """A table as text: in Markdown, and printed by rich in a terminal.

    Attributes:
        title: what it shows, above it in a terminal; pages have a heading of their own.
        header, rows: the cells; the first column stands to the left, the others to the right.
        note: what the numbers are, below it.
    """

    title: str
    header: Cells
    rows: Sequence[Cells]
    note: str = ""

    def markdown(self) -> str:
        """The cells, and the note."""
        lines = [self.header, ("---",) + ("---:",) * (len(self.header) - 1), *self.rows]
        shown = "\n".join(f"| {' | '.join(line)} |" for line in lines)
        return f"{shown}\n\n{self.note}" if self.note else shown

    def __rich__(self) -> rich.table.Table:
        shown = rich.table.Table(
            title=self.title or None,
            caption=self.note or None,
            box=box.SIMPLE_HEAD,
            pad_edge=False,
            collapse_padding=True,
        )
        for i, column in enumerate(self.header):
            shown.add_column(column, justify="right" if i else "left", overflow="fold")
        for row in self.rows:
            shown.add_row(*row)
        return shown


def progress(console: Console, *, shown: bool = True) -> Progress:
    """A bar that says what is measured, how many are done, and since when; none where it is not `shown`."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    return Progress(*columns, console=console, disable=not shown)


def ms(seconds: float) -> str:
    """Milliseconds with three digits."""
    return f"{1e3 * seconds:.3g}" if seconds < 1 else f"{1e3 * seconds:.0f}"
