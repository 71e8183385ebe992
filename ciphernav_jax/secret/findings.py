"""Public numbers that only the run knows, looked at where they meet secrets.

A trace cannot see whether a public argument is NaN. So each use of one adds a finding to the program, a bool
that the run computes beside its results. Findings leave the body of a loop and a branch as outputs do, and
those of all iterations are merged.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ciphernav_jax.jax_private import Tracer
from ciphernav_jax.secret.places import Place


class NotUsable(Exception):
    """A public number that is known while tracing cannot be used so; the message says why."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Findings:
    """Which public numbers turned out not to be usable; a pytree.

    Attributes:
        problems: for each use what is wrong, and where.
        found: for each use a bool: whether that is so.
    """

    problems: tuple[str, ...] = field(metadata={"static": True})
    found: tuple[Array, ...]

    @classmethod
    def of(cls, problem: str, place: Place, found: Array) -> "Findings":
        """Of one use; `found` may have any shape."""
        return cls((f"{problem}. It comes from {place}.",), (jnp.any(found),))

    @classmethod
    def joined(cls, parts: Iterable["Findings"]) -> "Findings":
        """Of several parts of a program."""
        parts = list(parts)
        return cls(
            tuple(problem for part in parts for problem in part.problems),
            tuple(found for part in parts for found in part.found),
        )

    def merged(self, other: "Findings") -> "Findings":
        """Of two runs of the same program."""
        return Findings(self.problems, tuple(a | b for a, b in zip(self.found, other.found, strict=True)))

    def any(self) -> Array:
        """Whether there is any problem."""
        return jnp.any(jnp.stack(self.found)) if self.found else jnp.zeros((), np.bool_)

    def check(self) -> None:
        """Raises ValueError with the first problem, where that can be known already."""
        for problem, found in zip(self.problems, self.found, strict=True):
            if not isinstance(found, Tracer) and found:
                raise ValueError(
                    f"{problem} Look at the public arguments before the call, or share what may be so large."
                )
