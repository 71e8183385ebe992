"""A table as text, what rows are called, and which commands make them."""

from collections.abc import Iterable
from dataclasses import dataclass

from ciphernav_jax import tables
from ciphernav_jax.navigation import metrics
from experiments.report.results import Results

ONE_SEED = ("secret-3", "secret-9", "secret-16")
ROWS = (
    "random",
    "map-only",
    "first-person",
    "first-person-deterministic",
    "secret-2",
    "secret-5",
    "plaintext",
    "plaintext-classifier",
    "plaintext-actions-alone",
    *ONE_SEED,
)
"""Of the tables of navigation, in their order."""
SHORT = ("map-only", "first-person", "secret-2", "secret-5", "plaintext")
"""Of the README's table."""
RECIPES = "paper-recipe"
"""Beginning of the names of rows that follow these."""
BEYOND = (
    *("secret-2", "longer-2", "beyond-2"),
    *("secret-5", "longer-5", "beyond-5"),
    *("plaintext-classifier", "longer-plaintext", "beyond-plaintext"),
    "alone",
)
"""Of the table past the paper: what it goes past, trained longer, and with careful robots on that."""
CHEAP = ("secret-2", "secret-5", "fewest-2", "fewest-5")
"""Trainings whose cost must be known; that of all others with secrets is shown too."""
SETS = {"test": "independent test set", "unseen": "unseen layouts"}
TITLES = {
    "fewest": "fewest steps",
    "longer": "trained longer",
    "longer-plaintext": "Plaintext, trained longer",
    "beyond": "trained longer, careful robot",
    "beyond-plaintext": "Plaintext, trained longer, careful robot",
    "alone": "Careful robot alone, nobody answers",
    "paper-recipe-samples": "Paper's recipe, 500 samples a step",
    "paper-recipe-environments": "Paper's recipe, 500 environments a step",
    "paper-recipe-secret": "paper's recipe",
}
SCRIPTS = {"fewest": "fewest_steps", "longer": "beyond", "beyond": "beyond", "alone": "beyond"}
"""In `experiments.paper`, of rows that `accuracy` does not make."""
OVER_SEEDS = "Ours: mean ± sample standard deviation over seeds"


@dataclass(frozen=True, kw_only=True)
class Table(tables.Table):
    """A table of the report.

    Attributes:
        name: of its block on a page.
        title, header, rows, note: as of every table. A name "group: column" stands under the group in HTML,
            and code in a note stands in backticks; there are no rows where no file is there.
        missing: commands that make what is not there.
    """

    name: str
    missing: tuple[str, ...] = ()

    def markdown(self) -> str:
        """Table, note, and what is missing."""
        parts = [super().markdown()] if self.rows else []
        return "\n\n".join([*parts, *(f"Missing; it is made by `{command}`." for command in self.missing)])


def title(name: str) -> str:
    """What to call a row."""
    kind, _, parties = name.rpartition("-")
    if name in TITLES:
        return TITLES[name]
    if kind in TITLES:
        return f"{parties} parties, {TITLES[kind]}"
    return metrics.title(name)


def duration(seconds: float) -> str:
    """In the unit that a person would choose."""
    for unit, size in (("days", 86400), ("h", 3600), ("min", 60)):
        if seconds >= 2 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"


def script(name: str, options: str = "") -> str:
    """The command of a script in `experiments.paper`."""
    return f"python -m experiments paper {name} {options}".strip()


def made_by(results: Results, names: Iterable[str]) -> tuple[str, ...]:
    """The commands that make the rows among `names` that are not there."""
    wanted: dict[tuple[str, bool], list[str]] = {}
    for name in names:
        if name not in results.runs:
            made = SCRIPTS.get(name.partition("-")[0], "accuracy"), name in ONE_SEED
            wanted.setdefault(made, []).append(name)
    return tuple(
        script(name, f"--rows {' '.join(rows)}{' --seeds 0' * one_seed}")
        for (name, one_seed), rows in wanted.items()
    )
