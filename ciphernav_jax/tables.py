"""Tables of measurements, for a terminal and in Markdown, and the bar while they are made."""

from collections.abc import Iterable

from rich import box
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

Cells = tuple[str, ...]


def markdown(header: Cells, rows: Iterable[Cells]) -> str:
    """The first column to the left, the others to the right."""
    lines = [header, ("---",) + ("---:",) * (len(header) - 1), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def terminal(title: str, header: Cells, rows: Iterable[Cells], note: str) -> Table:
    """The same for rich, with a note below."""
    shown = Table(title=title, caption=note, box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for i, column in enumerate(header):
        shown.add_column(column, justify="right" if i else "left", overflow="fold")
    for row in rows:
        shown.add_row(*row)
    return shown


def progress(console: Console, *, shown: bool = True) -> Progress:
    """A bar that says what is measured, how many are done, and since when; none where it is not `shown`."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    return Progress(*columns, console=console, disable=not shown)


def ms(seconds: float) -> str:
    """Milliseconds with three digits."""
    return f"{1e3 * seconds:.3g}" if seconds < 1 else f"{1e3 * seconds:.0f}"
