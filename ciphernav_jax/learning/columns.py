"""A table that is split vertically: same samples, and columns that each have an owner."""

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from ciphernav_jax.learning.sgd import Sgd
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.ring import keys
from ciphernav_jax.secret import is_secret, share

ANSWERS = "labels"


@dataclass(frozen=True)
class Column:
    """What one owner knows of every sample.

    Attributes:
        owner: the party that has it in the clear; it alone.
        values: float[rows, ...]; integers and bools, too.
        rows: int[samples], the row of each sample, where several samples have the same one; public. None
            where each has a row of its own.
    """

    owner: str
    values: Any
    rows: NDArray[np.integer] | None = None

    def __post_init__(self):
        if is_secret(self.values):
            raise TypeError(
                "a column is what its owner has in the clear; it is shared as the training begins"
            )
        if not isinstance(self.owner, str):
            raise TypeError(f"an owner is known by a name, not by {self.owner!r}")
        if not isinstance(self.values, jax.Array):
            object.__setattr__(self, "values", np.asarray(self.values))
        if self.values.ndim == 0:
            raise ValueError("a column has a row for each sample; this is a single number")
        if self.rows is None:
            return
        rows, count = np.asarray(self.rows), len(self.values)
        object.__setattr__(self, "rows", rows)
        if rows.ndim != 1 or not np.issubdtype(rows.dtype, np.integer):
            raise ValueError(f"rows are int[samples], not {rows.dtype}{list(rows.shape)}")
        if rows.size and not 0 <= rows.min() <= rows.max() < count:
            raise ValueError(
                f"rows lie in 0..{count - 1}, those of the values; these in {rows.min()}..{rows.max()}"
            )

    def __len__(self) -> int:
        return len(self.values if self.rows is None else self.rows)

    def at(self, samples: NDArray[np.integer]) -> NDArray[np.integer]:
        """The rows of these samples."""
        return samples if self.rows is None else self.rows[samples]


@dataclass(frozen=True)
class SplitTable:
    """All columns, and the answers.

    Attributes:
        columns: by name, in the order in which a network takes them.
        answers: the column to be learned, float[samples, outputs].

    Raises:
        ValueError: columns of different numbers of samples, or one named "labels", as the answers are.

    Example:
        >>> import numpy as np
        >>> from ciphernav_jax.learning import Column, SplitTable
        >>> ages, results = np.ones((4, 1)), np.ones((4, 2))
        >>> table = SplitTable({"age": Column("first", ages)}, answers=Column("second", results))
        >>> len(table), table.owners
        (4, ('first', 'second'))
    """

    columns: Mapping[str, Column]
    answers: Column

    def __post_init__(self):
        if ANSWERS in self.columns:
            raise ValueError(f"no column can be named {ANSWERS!r}: the answers are; choose another name")
        for name, column in self.columns.items():
            if len(column) != len(self.answers):
                raise ValueError(
                    f"column {name!r} has {len(column)} samples, the answers {len(self.answers)}: give each "
                    "the same samples in the same order, or say in `rows` which row each sample has"
                )

    def __len__(self) -> int:
        return len(self.answers)

    @property
    def owners(self) -> tuple[str, ...]:
        """Who holds something, each once."""
        return tuple(dict.fromkeys(column.owner for column in (*self.columns.values(), self.answers)))

    @property
    def values(self) -> tuple[tuple, Any]:
        """Of the columns and of the answers, in the clear."""
        return tuple(column.values for column in self.columns.values()), self.answers.values

    def shared(self, key: jax.Array, parties: int, protocol: Protocol | None = None) -> tuple[tuple, Any]:
        """`values` as secrets: each owner shares its columns once, with randomness of its own.

        Raises:
            ValueError: more owners than parties.
        """
        if len(self.owners) > parties:
            raise ValueError(
                f"{', '.join(self.owners)} hold columns, but there are {parties} parties: "
                f"share among {len(self.owners)} or more"
            )

        def secret(name: str, column: Column) -> Any:
            own = keys.derive(key, column.owner, name)
            return share(own, column.values, parties=parties, protocol=protocol)

        columns = tuple(secret(name, column) for name, column in self.columns.items())
        return columns, secret(ANSWERS, self.answers)

    def batches(self, recipe: Sgd, seed: int, steps: NDArray[np.int64]) -> tuple:
        """Of each step its number, by how much the rate has fallen, and the rows of its samples in each
        column and in the answers; all public.
        """
        samples = np.stack([_samples(step, len(self), recipe.batch, seed) for step in steps.tolist()])
        decay = (1 - steps / recipe.steps * (recipe.schedule == "linear")).astype(np.float32)
        rows = tuple(column.at(samples) for column in self.columns.values())
        return steps, decay, (rows, self.answers.at(samples))


def picked(values: tuple[tuple, Any], rows: tuple[tuple, Any]) -> tuple[tuple, Any]:
    """The columns and the answers of a batch, of what `SplitTable.values` or `SplitTable.shared` gives."""
    (columns, answers), (of_columns, of_answers) = values, rows
    return tuple(x[row] for x, row in zip(columns, of_columns, strict=True)), answers[of_answers]


def _samples(step: int, count: int, batch: int, seed: int) -> NDArray[np.int64]:
    # Each epoch is a permutation of the samples, cut into batches, the remainder left out.
    epoch, place = divmod(step, max(1, count // batch))
    return _order(epoch, count, seed)[np.arange(place * batch, (place + 1) * batch) % count]


@functools.lru_cache(maxsize=1)  # permuting all samples takes a third as long as a secret step
def _order(epoch: int, count: int, seed: int) -> NDArray[np.int64]:
    return np.random.default_rng([seed, epoch]).permutation(count)
