"""The table of all primitives that `secure` takes, with what each costs and how far off it may be.

    python -m experiments primitives > docs/primitives.md

Rounds and bytes come from `cost`, and so from the rules themselves. The error beside each example is a bound
that follows from its truncations; the tests evaluate all examples and compare.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from ciphernav_jax.secret import Cost, cost, secure, share

ENTRIES = 64
PUBLIC, SECRET = ("w", "n"), ("x", "y", "a", "b", "p", "q")
NAMES = (*PUBLIC, *SECRET)
SHAPES: dict[str, tuple[tuple[int, ...], Any]] = {
    **dict.fromkeys(("w", "x", "y"), ((ENTRIES,), jnp.float64)),
    **dict.fromkeys(("a", "b"), ((8, 8), jnp.float64)),
    **dict.fromkeys(("p", "q"), ((ENTRIES,), jnp.bool_)),
    "n": ((), jnp.int64),
}


@dataclass(frozen=True)
class Example:
    """One row of the table.

    Attributes:
        primitive: as JAX names it.
        expression: applies it, an expression in `NAMES`.
        error: bound on each entry's error in units of the last place, an expression in `NAMES`.
    """

    primitive: str
    expression: str
    error: str = "0"

    # The expressions that are shown are the ones that are evaluated.

    @property
    def function(self) -> Callable[..., Any]:
        """Of what `NAMES` lists."""
        return eval(f"lambda {', '.join(NAMES)}: {self.expression}", {"jax": jax, "jnp": jnp, "lax": lax})

    @property
    def bound(self) -> Callable[..., Any]:
        """Of what `NAMES` lists, in the clear."""
        return eval(f"lambda {', '.join(NAMES)}: {self.error}")


# A truncation errs by less than one unit. A public array is encoded to half a unit, and a constant to 2^-20
# of itself; what it multiplies multiplies that too.
FAMILIES = {
    "Data movement: the same operation on the shares": (
        Example("broadcast_in_dim", "jnp.broadcast_to(x, (3, 64))"),
        Example("concatenate", "jnp.concatenate([x, y])"),
        Example("copy", "jnp.copy(x)"),
        Example("cumsum", "jnp.cumsum(x)"),
        Example("dynamic_slice", "lax.dynamic_slice(x, (n,), (8,))"),
        Example("dynamic_update_slice", "lax.dynamic_update_slice(x, w[:8], (n,))", "1 / 2"),
        Example("gather", "x[jnp.array([3, 1, 1])]"),
        Example("pad", "lax.pad(x, 0.0, [(1, 1, 0)])"),
        Example("reshape", "jnp.reshape(x, (8, 8))"),
        Example("rev", "jnp.flip(x)"),
        Example("scatter", "x.at[jnp.array([3, 1])].set(0.5)"),
        Example("slice", "lax.slice(x, (8,), (16,))"),
        Example("split", "jnp.split(x, 2)[0]"),
        Example("squeeze", "jnp.squeeze(x[None])"),
        Example("stack", "jnp.stack([x, y])"),
        Example("tile", "jnp.tile(x, 3)"),
        Example("transpose", "a.T"),
        Example("unstack", "jnp.unstack(a)[0]"),
    ),
    "Linear: local": (
        Example("add", "x + y"),
        Example("add_any", "jax.vjp(lambda z: (z, z), x)[1]((x, y))[0]"),
        Example("convert_element_type", "p.astype(jnp.float64)"),
        Example("neg", "-x"),
        Example("reduce_sum", "jnp.sum(a, axis=1)"),
        Example("scatter-add", "x.at[jnp.array([3, 3])].add(0.5)"),
        Example("stop_gradient", "lax.stop_gradient(x)"),
        Example("sub", "x - y"),
    ),
    "Products": (
        Example("mul", "x * y", "1"),
        Example("mul", "x * w", "2 + abs(x) / 2**21"),
        Example("mul", "x * 0.3", "1 + 0.3 * abs(x)"),
        Example("mul", "x * 3.0"),
        Example("div", "x / w", "2 + abs(x) / 2**21"),
        Example("dot_general", "a @ b", "1"),
        Example("dot_general", "a @ jnp.reshape(w, (8, 8))", "1 + abs(a).sum(axis=1, keepdims=True) / 2"),
        Example("integer_pow", "x ** 3", "1 + abs(x)"),
        Example("square", "jnp.square(x)", "1"),
    ),
    "Comparisons: exact, of the values as they are encoded": (
        Example("convert_element_type", "x.astype(jnp.bool_)"),
        Example("eq", "x == y"),
        Example("ge", "x >= y"),
        Example("gt", "x > y"),
        Example("is_finite", "jnp.where(jnp.isfinite(x), x, 0.0)"),
        Example("le", "x <= y"),
        Example("lt", "x < y"),
        Example("ne", "x != y"),
        Example("sign", "jnp.sign(x)"),
    ),
    "Selection": (
        Example("abs", "jnp.abs(x)"),
        Example("argmax", "jnp.argmax(a, axis=1)"),
        Example("argmin", "jnp.argmin(a, axis=1)"),
        Example("clamp", "lax.clamp(-1.0, x, 1.0)"),
        Example("max", "jnp.maximum(x, 0.0)"),
        Example("max", "jnp.maximum(x, y)"),
        Example("min", "jnp.minimum(x, y)"),
        Example("reduce_max", "jnp.max(a, axis=1)"),
        Example("reduce_min", "jnp.min(a, axis=1)"),
        Example("select_n", "lax.select(p, x, y)"),
        Example("select_n", "lax.select(w > 0, x, y)"),
    ),
    "Logic on secret bits": (
        Example("and", "p & q"),
        Example("not", "~p"),
        Example("or", "p | q"),
        Example("reduce_and", "jnp.all(jnp.reshape(p, (8, 8)), axis=1)"),
        Example("reduce_or", "jnp.any(jnp.reshape(p, (8, 8)), axis=1)"),
        Example("xor", "p ^ q"),
    ),
    "Loops and branches, decided by public values": (
        Example("cond", "lax.cond(n > 2, lambda: x * y, lambda: x)", "1"),
        Example("scan", "lax.map(lambda row: row * row, a)", "1"),
        Example("while", "lax.fori_loop(0, n, lambda i, z: z + x * y, x)", "n"),
    ),
}


def examples() -> list[Example]:
    """All rows, in order."""
    return [example for family in FAMILIES.values() for example in family]


def example_cost(example: Example, parties: int = 2) -> Cost:
    """What it costs with the default protocol. Nothing is run."""
    arguments = {name: jax.ShapeDtypeStruct(*SHAPES[name]) for name in NAMES}
    shared = jax.eval_shape(
        partial(share, parties=parties), jax.random.key(0), [arguments[name] for name in SECRET]
    )
    return cost(secure(example.function), *[arguments[name] for name in PUBLIC], *shared)


HEAD = f"""# What `secure` takes

<!-- made by: python -m experiments primitives > docs/primitives.md -->

Each primitive of JAX that has a rule, on an example, with the default `Protocol`. Secret are the vectors
`x`, `y` of {ENTRIES} floats, the 8 x 8 matrices `a`, `b` and the vectors `p`, `q` of {ENTRIES} bools; public,
and unknown until the run, are the vector `w` and the integer `n`.

- **Rounds**: messages that wait for one another.
- **Sent**: bytes that each party sends to each other party, divided by {ENTRIES}: for each entry of `x`.
- **Dealt**: bytes that the dealer sends to all parties together, likewise; without the seed that each gets.
- **Error**: a bound in units of the last place, 2^-20, for values in range; 0 is exact.

None of it depends on the number of parties. Operands come fresh and results are truncated to 20 fractional
bits, so a product pays for the openings of its two factors and for its truncation. Inside a function it is
often less: a value is opened once for all its products, the bit of a comparison is open already, and a matrix
product is truncated once an entry, by the operation that needs it or along with a ReLU. `cn.cost` counts your
function as it stands. Of a `while` that only the run ends, one iteration is counted.
"""


def markdown() -> str:
    """The whole page."""
    parts = [HEAD]
    for title, family in FAMILIES.items():
        rows = "\n".join(_row(example, example_cost(example)) for example in family)
        parts.append(
            f"## {title}\n\n| primitive | example | rounds | sent | dealt | error |\n"
            f"| --- | --- | ---: | ---: | ---: | --- |\n{rows}\n"
        )
    return "\n".join(parts)


def _row(example: Example, found: Cost) -> str:
    rounds = f"{found.rounds}{' an iteration' * found.unbounded}"
    sent = found.bytes_sent / (found.parties - 1) / ENTRIES
    dealt = (sum(row.bytes_dealt for row in found.by_request) + found.bytes_on_call) / ENTRIES
    expression = example.expression.replace("|", "\\|")
    return (
        f"| `{example.primitive}` | `{expression}` | {rounds} | {_bytes(sent)} | {_bytes(dealt)} "
        f"| {_bound(example.error)} |"
    )


def _bytes(x: float) -> str:
    return f"{x:.1f}".removesuffix(".0")


def _bound(error: str) -> str:
    return error if error.isdigit() else f"`{error}`"
