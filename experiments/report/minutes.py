"""A table of how long the experiments take, from the seconds in their result files."""

from collections.abc import Iterator

from ciphernav_jax.tables import Cells
from experiments.report.results import Document, Results
from experiments.report.table import SCRIPTS, Table, duration, script

UNKNOWN = "not measured"
NOTE = (
    "What the files of results add up to, on the machine that made them. Rendering of data sets is not in "
    "it, nor the training of encoders that a script found. Memory: the largest process. Other commands were "
    "not measured, nor was the disk that data sets and trainings take."
)


def minutes(results: Results) -> Table:
    """Of all scripts of the paper's, and of the benchmarks."""
    rows = [_row(command, documents) for command, documents in sorted(_by_command(results).items())]
    if results.bench:
        largest = max(result["peak_bytes"] for result in results.bench["results"])
        count = str(len(results.bench["results"]))
        rows.append(("`python -m experiments bench`", count, UNKNOWN, UNKNOWN, f"{largest / 1e9:.2g} GB"))
    return Table(
        name="minutes",
        title="How long the experiments take",
        header=("command", "runs", "all of them", "the longest", "memory"),
        rows=rows,
        note=NOTE,
        missing=() if rows else (script("accuracy"),),
    )


def _by_command(results: Results) -> dict[str, list[Document]]:
    found: dict[str, list[Document]] = {}
    for name, documents in results.runs.items():
        made_by = "paper_recipe" if name.startswith("paper-recipe") else SCRIPTS.get(name.partition("-")[0])
        found.setdefault(script(made_by or "accuracy"), []).extend(documents)
    for name, documents in results.others.items():
        found[script(name)] = documents
    return found


def _row(command: str, documents: list[Document]) -> Cells:
    seconds = list(_seconds(documents))
    known = len(seconds) == len(documents) > 0
    times = (duration(sum(seconds)), duration(max(seconds))) if known else (UNKNOWN, UNKNOWN)
    return (f"`{command}`", str(len(documents)), *times, UNKNOWN)


def _seconds(documents: list[Document]) -> Iterator[float]:
    """Of each document that has them: a number, the sum of all parts, or the part "all"."""
    for document in documents:
        match document.get("seconds"):
            case {"all": whole}:
                yield whole
            case dict() as parts:
                yield sum(parts.values())
            case int() | float() as whole:
                yield whole
