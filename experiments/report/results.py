"""What the result files hold, and numbers over seeds."""

import statistics
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from ciphernav_jax.files import read_json
from ciphernav_jax.navigation import metrics

Document = dict[str, Any]


@dataclass(frozen=True)
class Results:
    """All that was measured, as far as there are files.

    Attributes:
        runs: the documents of `experiments.paper.runs.run_row` by row, in the order of seeds.
        others: those of the other scripts in `experiments.paper` by the script's word, such as "forward".
        bench: of `python -m experiments bench`.
    """

    runs: dict[str, list[Document]]
    others: dict[str, list[Document]]
    bench: Document | None

    def documents(self) -> list[Document]:
        """Every document."""
        found = [d for group in (self.runs, self.others) for documents in group.values() for d in documents]
        return [*found, self.bench] if self.bench else found


def load(folder: Path) -> Results:
    """Everything in FOLDER/paper and FOLDER/bench.json that is there; see `read`."""
    return gathered(read(folder))


def read(folder: Path) -> dict[Path, Document]:
    """The documents by their files.

    Raises:
        FileNotFoundError: no such folder.
        DamagedError: a file is not what was written.
    """
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder} is missing; say with --results where the result files are")
    paths = sorted((folder / "paper").glob("*.json"))
    bench = folder / "bench.json"
    return {path: read_json(path) for path in [*paths, *[bench] * bench.exists()]}


def gathered(documents: dict[Path, Document]) -> Results:
    """The documents by what they are of."""
    runs: dict[str, list[Document]] = defaultdict(list)
    others: dict[str, list[Document]] = defaultdict(list)
    bench = None
    for path, document in documents.items():
        if path.stem == "bench":
            bench = document
        elif "curve" in document:  # a training's, or the random walk's empty one
            runs[document["row"]].append(document)
        else:
            others[path.stem.partition("-")[0]].append(document)
    for of_row in runs.values():
        of_row.sort(key=lambda document: document["seed"])
    return Results(dict(runs), dict(others), bench)


class Spread(NamedTuple):
    """A number over seeds: its mean, and the sample standard deviation, none of one seed."""

    mean: float
    sd: float | None

    def text(self, digits: int = 2) -> str:
        """As in "99.10 ± 0.22"."""
        return f"{self.mean:.{digits}f}" + ("" if self.sd is None else f" ± {self.sd:.{digits}f}")


def spread(documents: list[Document], value: Callable[[Document], float]) -> Spread:
    """Of a value of each document."""
    values = [value(document) for document in documents]
    return Spread(statistics.fmean(values), statistics.stdev(values) if len(values) > 1 else None)


def seeds(documents: list[Document]) -> str:
    """How many there are, in words fit for a table."""
    return "one" if len(documents) == 1 else str(len(documents))


def truncations(documents: list[Document]) -> tuple[int, int]:
    """How many the trainings carried out, and how many failed."""
    points = [point for document in documents for point in document["curve"] if "truncations" in point]
    return sum(point["truncations"] for point in points), sum(point["failed"] for point in points)


def overall_accuracy(document: Document, test_set: str = "test") -> float:
    """In percent."""
    return metrics.accuracy(metrics.overall(document["results"][test_set]["counts"]))
