"""All rows of a comparison, as tables, Markdown and JSON."""

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console, Group

from ciphernav_jax import extras
from ciphernav_jax.comparison.rows import Row
from ciphernav_jax.tables import Cells, Table

NOTE = (
    "Milliseconds of a warm call, median; all parties and the dealer on one machine. Compiling: with nothing "
    "from the persistent cache. Sent: by each party, dealt: to all together. LAN and WAN: projected for the "
    "messages alone. Errors of values and of the gradient: the largest against {reference}; units: of the "
    "last place. Failed: truncations that landed farther off than any rounding. Ideal: a trusted third "
    "party, not a protocol; counted is what is left beside it."
)
IDEAL = " (ideal: not a protocol)"
"""What is said of a variant that is none."""
REFERENCES = {
    "float64": "float64",
    "own": "the function in its arguments' own dtypes, for it takes no float64",
}

Column = tuple[str, Callable[[Row], str]]

TIMES: tuple[Column, ...] = (
    ("ms", lambda row: _digits(row.seconds, 1e3)),
    ("compile s", lambda row: _digits(row.compile_seconds)),
    ("memory MB", lambda row: _digits(row.memory_bytes, 1e-6)),
)
MESSAGES: tuple[Column, ...] = (
    ("rounds", lambda row: _count(row.rounds) + " or more" * bool(row.unbounded)),
    ("bytes sent", lambda row: _count(row.bytes_sent)),
    ("bytes dealt", lambda row: _count(row.bytes_dealt)),
    ("LAN s", lambda row: _digits(row.lan_seconds)),
    ("WAN s", lambda row: _digits(row.wan_seconds)),
)
ERRORS: tuple[Column, ...] = (
    ("error", lambda row: _small(row.error)),
    ("units", lambda row: _digits(row.error_units)),
    ("gradient", lambda row: _small(row.gradient_error)),
    ("its units", lambda row: _digits(row.gradient_error_units)),
    ("truncations", lambda row: _count(row.truncations)),
    ("failed", lambda row: _count(row.failed)),
)
PARTS = (TIMES, MESSAGES, ERRORS)
"""Each is narrow enough for a terminal."""


@dataclass(frozen=True)
class Comparison:
    """What `compare` found; printed as tables.

    Attributes:
        rows: one for each protocol with each number of parties.
        configuration: name and digest of the function, shapes of its arguments, which are public, the seed,
            and the dtype of the reference.
        versions, machine: on what it was measured.
    """

    rows: tuple[Row, ...]
    configuration: dict[str, Any]
    versions: dict[str, str]
    machine: dict[str, str | int]

    def as_dict(self) -> dict[str, Any]:
        """All of it, for JSON."""
        return {
            "configuration": self.configuration,
            "versions": self.versions,
            "machine": self.machine,
            "rows": [row.as_dict() for row in self.rows],
        }

    @staticmethod
    def from_dict(document: dict[str, Any]) -> "Comparison":
        """What `as_dict` gave, also by way of JSON."""
        rows = tuple(map(Row.from_dict, document["rows"]))
        return Comparison(rows, document["configuration"], document["versions"], document["machine"])

    def summary(self) -> str:
        """What was compared, and on what."""
        machine, seed = self.machine, self.configuration["seed"]
        return (
            f"{self.configuration['function']} on {machine['cpus']} cores of {machine['processor']}, "
            f"jax {self.versions['jax']}, seed {seed}."
        )

    def markdown(self) -> str:
        """One table with all columns, and the reasons of what was refused."""
        reasons = "".join(f"- {reason}\n" for reason in self.reasons())
        return f"{self.summary()}\n\n{self.table().markdown()}\n{chr(10) * bool(reasons)}{reasons}"

    def table(self) -> Table:
        """All columns in one, and what they are."""
        columns = tuple(column for part in PARTS for column in part)
        return Table("Variants compared", *self._cells(columns), self._note())

    def reasons(self) -> list[str]:
        """Why rows have no numbers, or no gradient."""
        refused = [f"{_subject(row)}: {row.refused}" for row in self.rows if row.refused]
        without = dict.fromkeys(row.no_gradient for row in self.rows if row.no_gradient)
        if len(without) == 1 and all(row.refused or row.no_gradient for row in self.rows):
            return [*refused, f"No gradient: {next(iter(without))}."]
        return refused + [
            f"{_subject(row)}, no gradient: {row.no_gradient}" for row in self.rows if row.no_gradient
        ]

    def picture(self, path: str | Path) -> None:
        """Writes a PNG: seconds and projected seconds by parties, errors of values and gradients by variant.

        Raises:
            ModuleNotFoundError: matplotlib is not installed; the message says how to.
        """
        extras.require("navigation", "the picture of a comparison", "matplotlib")
        from ciphernav_jax.comparison import pictures

        pictures.draw(self.rows, self.configuration["function"], Path(path))

    def _note(self) -> str:
        return NOTE.format(reference=REFERENCES[self.configuration["reference"]])

    def _cells(self, columns: tuple[Column, ...]) -> tuple[Cells, list[Cells]]:
        """Header and rows of some columns."""
        header = ("variant", "P", *(name for name, _ in columns))
        return header, [(*_named(row), *_cells(row, columns)) for row in self.rows]

    def __rich__(self) -> Group:
        parts = (Table("", *self._cells(columns)) for columns in PARTS)
        return Group(self.summary(), *parts, *self.reasons(), self._note())

    def __str__(self) -> str:
        text = io.StringIO()
        Console(file=text, width=110).print(self)
        return "\n".join(line.rstrip() for line in text.getvalue().rstrip().splitlines())


def _named(row: Row) -> tuple[str, str]:
    return row.protocol + IDEAL * row.ideal, str(row.parties)


def _subject(row: Row) -> str:
    return f"{row.protocol}, {row.parties} parties"


def _cells(row: Row, columns: tuple[Column, ...]) -> list[str]:
    if row.refused:
        return ["refused", *("" for _ in columns[1:])]
    return [cell(row) for _, cell in columns]


def _digits(x: float | None, scale: float = 1.0) -> str:
    """Three digits."""
    if x is None:
        return "-"
    return f"{scale * x:,.0f}" if abs(scale * x) >= 100 else f"{scale * x:.3g}"


def _small(x: float | None) -> str:
    return "-" if x is None else f"{x:.1e}" if x else "0"


def _count(x: int | None) -> str:
    return "-" if x is None else f"{x:,}"
