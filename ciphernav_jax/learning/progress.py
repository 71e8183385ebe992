"""Progress bars for trainings."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

Report = Callable[[int, int, dict], None]
"""Called as report(done, total, curve point) after each epoch, or each chunk of steps."""


@contextmanager
def bar(title: str) -> Iterator[Report]:
    """Show a bar with what was last reported beside it; yields the function to report to."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[latest]}"),
        TextColumn("remaining"),
        TimeRemainingColumn(),
    )
    with Progress(*columns) as progress:
        task = progress.add_task(title, total=None, latest="compiling")

        def report(done: int, total: int, point: dict) -> None:
            progress.update(task, completed=done, total=total, latest=_words(point))

        yield report
        if progress.tasks[task].total is None:  # nothing was left to do
            progress.update(task, completed=1, total=1, latest="was there already")


def _words(point: dict) -> str:
    words = [f"loss {point['loss']:.4f}"]
    if "accuracy" in point:
        words.append(f"accuracy {point['accuracy']:.1f} %")
    return ", ".join(words)
