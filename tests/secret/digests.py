"""Digests of what calls compute and send: of shares, messages, costs and results, bit for bit.

    python -m tests.secret.digests > tests/secret/digests.json    # of 2, 3 and 5 parties; twenty minutes

They hold a rebuilding of the engine to its bits. Record them anew only with a change of what is dealt,
computed or sent, and say why in its commit. Functions are traced as ever and evaluated one operation at a
time, which gives the bits of the compiled program and compiles far less; but for loops and the training.
"""

import hashlib
import json
import sys
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend.core import jaxpr_as_fun

import ciphernav_jax as cn
from experiments import primitives
from experiments.work import Sizes, works

from .random_programs.checking import step_by_step
from .random_programs.variants import variants
from .test_loops import FUNCTIONS, N
from .test_loops import X as ROWS

PARTIES = [2, 3, 5]


@dataclass(frozen=True)
class Call:
    """A function with its arguments; `secret` says which of them are shared."""

    function: Callable[..., Any]
    args: tuple[Any, ...]
    secret: tuple[bool, ...]
    protocol: cn.Protocol = cn.Protocol()  # noqa: RUF009  (frozen)
    recorded: bool = True  # its messages too; there are none of a branch or of a loop on call


def arguments() -> tuple[Any, ...]:
    """Of the examples of all primitives, on a grid that is encoded without error."""
    rng = np.random.default_rng(0)

    def grid(*shape):
        return np.round(rng.uniform(-4, 4, shape) * 256) / 256

    x, y, a, b = grid(64), grid(64), grid(8, 8), grid(8, 8)
    y[:8] = x[:8]  # equal entries too
    return rng.uniform(0.5, 2, 64), 3, x, y, a, b, x > 1, y > 0


def mixed(w, x, y, table):
    """Some of everything that variants differ in."""
    hidden = jax.nn.relu(x @ w)

    def loss(w):
        return jnp.sum(jnp.square(jax.nn.relu(x @ w) - y))

    def step(carry, row):
        return 0.5 * carry + row * row, jnp.max(row)

    return (
        jax.value_and_grad(loss)(w),
        jnp.where(hidden > y, hidden, y) * table,
        jnp.argmax(hidden, axis=1),
        jnp.clip(jnp.mean(hidden, axis=0), -1.0, 0.5),
        lax.scan(step, jnp.zeros_like(y[0]), y),
        jnp.any(hidden == jnp.max(hidden)),
    )


def calls() -> Iterator[tuple[str, Call]]:
    """All of them by name, for each number of parties."""
    given = arguments()
    public, secret = primitives.PUBLIC, primitives.SECRET
    for example in primitives.examples():
        which = (False,) * len(public) + (True,) * len(secret)
        recorded = example.primitive not in ("cond", "while")
        yield (
            f"{example.primitive}: {example.expression}",
            Call(example.function, given, which, recorded=recorded),
        )
    rng = np.random.default_rng(1)
    shapes = ((3, 2), (4, 3), (4, 2))
    args = tuple(np.round(rng.uniform(-1, 1, shape) * 256) / 256 for shape in shapes)
    table = np.array([0.001, 1000.0])
    for name, protocol in variants().items():
        yield f"variant {name}", Call(mixed, (*args, table), (True, True, True, False), protocol)


def digest(name: str, call: Call, parties: int) -> dict[str, str]:
    """What each part of a call amounts to."""
    key = jax.random.key(zlib.crc32(f"{name} {parties}".encode()))
    keys = jax.random.split(key, len(call.args) + 1)
    traced = jaxpr_as_fun(jax.make_jaxpr(call.function)(*call.args))
    with step_by_step():
        given = [
            cn.share(key, x, parties=parties, protocol=call.protocol) if secret else jnp.asarray(x)
            for key, x, secret in zip(keys[1:], call.args, call.secret, strict=True)
        ]
        step = cn.secure(traced, protocol=call.protocol)
        if call.recorded:
            results, messages = cn.transcript(step)(keys[0], *given)
        else:
            results, messages = step(keys[0], *given), ()
        cost = cn.cost(step, *given)
        return {
            "shares": hashed(results),
            "messages": hashed([(message.sent, message.opened) for message in messages]),
            "cost": hashlib.sha256(json.dumps(cost.as_dict()).encode()).hexdigest()[:16],
            "results": hashed(cn.reveal(results)),
        }


def looped(parties: int) -> dict[str, dict[str, str]]:
    """All functions with loops and branches in one call, compiled."""
    step = cn.secure(lambda *args: {name: f(*args) for name, (f, _) in FUNCTIONS.items()})
    results = step(jax.random.key(8), cn.share(jax.random.key(7), ROWS, parties=parties), N)
    return {
        f"loops: {name}": {"shares": hashed(x), "results": hashed(cn.reveal(x))}
        for name, x in results.items()
    }


def trained(parties: int) -> dict[str, str]:
    """A hundred steps of training, in one loop."""
    work = works(Sizes(widths=(12, 8, 5), train=20, steps=100))["train-loop"]
    secrets = [cn.share(jax.random.key(i), x, parties=parties) for i, x in enumerate(work.args)]
    results = jax.jit(work.secured(cn.Protocol()))(jax.random.key(9), *secrets)
    return {"shares": hashed(results), "results": hashed(cn.reveal(results))}


def hashed(tree: Any) -> str:
    """Of all arrays in a tree, their types and shapes."""
    found = hashlib.sha256()
    for leaf in jax.tree.leaves(tree, is_leaf=lambda x: isinstance(x, cn.Secret)):
        array = np.asarray(leaf.shares if isinstance(leaf, cn.Secret) else leaf)
        found.update(f"{array.dtype} {array.shape}".encode())
        found.update(np.ascontiguousarray(array).tobytes())
    return found.hexdigest()[:16]


def all_digests(parties: int) -> dict[str, dict[str, str]]:
    """Those of every call and of the training, for a number of parties."""
    found = {
        name: digest(name, call, parties)
        for name, call in calls()
        if call.protocol.truncation != "local" or parties == 2
    }
    return found | looped(parties) | {"training": trained(parties)}


if __name__ == "__main__":
    jax.config.update("jax_numpy_dtype_promotion", "strict")
    found = {str(parties): all_digests(parties) for parties in map(int, sys.argv[1:] or PARTIES)}
    print(json.dumps({"jax": jax.__version__, "digests": found}, indent=1))
