"""Many compiled programs in one process: it lives, and what it computes stays right.

    python -m experiments programs --count 500

So many functions with their gradients are compiled on secrets and kept, in turn each by itself, as a part
of another jitted function, and through `simulate`; then all are called again. Each result is compared with
JAX's own. At the end: the largest number of memory maps seen, beside what a process may have.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from ciphernav_jax.ring import keys
from ciphernav_jax.secret import reveal, secure, share, simulate
from ciphernav_jax.secret.compiled import ALLOWED, MAPS

ROOT = keys.root(0)
RNG = np.random.default_rng(0)
W, X, Y = (RNG.normal(size=shape).astype(np.float32) for shape in ((4, 3), (5, 4), (5, 3)))
BOUND = 1e-3  # a wide one: some thousand units


def loss(factor: float) -> Callable[..., jax.Array]:
    return lambda w: factor * jnp.mean((jax.nn.relu(X @ w) - Y) ** 2)


def by_itself(factor: float) -> Callable[..., jax.Array]:
    step = secure(jax.grad(loss(factor)))

    def through_shares(key, w):
        secret = share(keys.derive(key, "share"), w, parties=2)
        return reveal(step(keys.derive(key, "step"), secret))

    return through_shares


def part_of_another(factor: float) -> Callable[..., jax.Array]:
    return jax.jit(by_itself(factor))


def through_the_protocol(factor: float) -> Callable[..., jax.Array]:
    simulated = simulate(loss(factor), parties=2)
    return jax.grad(simulated, argnums=1)


def compile_many(count: int) -> None:
    """Compile, call, call again and compare.

    Raises:
        RuntimeError: a result is not what it should be.
    """
    ways = (by_itself, part_of_another, through_the_protocol)
    factors = [1 + i / count for i in range(count)]
    functions = [ways[i % len(ways)](factor) for i, factor in enumerate(factors)]
    expected = jax.grad(loss(1.0))(W)
    most = 0
    for done in ("compiled", "called again"):
        for i, (factor, function) in enumerate(zip(factors, functions, strict=True)):
            error = np.max(np.abs(function(keys.derive(ROOT, done, i), W) - factor * expected))
            if error > BOUND:
                raise RuntimeError(f"function {i}, {ways[i % len(ways)].__name__}, is {error:g} off")
            with MAPS.open("rb") as lines:
                most = max(most, sum(1 for _ in lines))
            if i % 10 == 9:
                print(f"{done} {i + 1}, {most:,} maps at most", flush=True)
    print(f"{count} functions, {most:,} of {int(ALLOWED.read_text()):,} maps at most")
