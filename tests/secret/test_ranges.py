"""Whatever is done to values within the contract of docs/ranges.md comes out right, up to its ends.

Each function is computed on secrets and, independently, in float64 by numpy. With f fractional bits, one unit
is 2^-f and R = 2^(62 - 2f) is what shared values and products stay below. A bound counts truncations, each
off by at most a unit (P units for "wrap-count"), times what multiplies them afterwards.
"""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ciphernav_jax as cn

MANY = 3000
ENDS = np.array([0.9, -0.9, 0.9, -0.9, 1e-3, 0.0])
OTHER = np.array([0.9, 0.9, -0.9, -0.9, -1e-3, 0.0])


def arguments(f: int) -> dict[str, np.ndarray]:
    """Secrets at the ends of the range, exact in fixed point: `e`, `o` of size R, `x`, `y` with products of
    size R, `n` and `m` many entries of size R and sqrt R, `b` bits, `s` small.
    """
    reach, root = 2.0 ** (62 - 2 * f), 2.0 ** (31 - f)

    def exact(values):
        return np.round(np.asarray(values) * 2.0**f) / 2.0**f

    return {
        "e": exact(reach * ENDS),
        "o": exact(reach * OTHER),
        "x": exact(root * ENDS / 1.5),
        "y": exact(root * 1.5 * np.ones(6)),
        "z": exact(root * OTHER / 1.5),
        "n": exact(reach * np.linspace(0.7, 0.9, MANY)),
        "m": exact(root * np.linspace(0.7, 0.9, MANY)),
        "s": exact(np.linspace(-3, 3, 6)),
        "b": np.array([True, False, True, False, True, False]),
    }


def public(f: int) -> dict[str, np.ndarray]:
    """Public numbers that only the run knows."""
    reach = 2.0 ** (62 - 2 * f)
    return {
        "p": np.array([3e-7, -1e-3, 0.3, 1.0, -0.7, 1e-5]),
        "q": np.array([-1e9, 1e9, -reach / 2, reach / 2, 0.0, -1e9]),
    }


def contexts():
    """(P, protocol): each number of parties, truncation and fractional bits."""
    yield 2, cn.Protocol()
    yield 3, cn.Protocol(frac_bits=16, truncation="nearest")
    yield 5, cn.Protocol(frac_bits=24, truncation="floor")
    yield 2, cn.Protocol(frac_bits=16, comparison="resharing")
    yield 3, cn.Protocol(truncation="ideal", comparison="ideal", multiplication="ideal")


CONTEXTS = list(contexts())

# name: (function of the arguments by name, bound in units: a number, or a function of f and the arguments)
FUNCTIONS = {
    # Sums.
    "mean": (lambda a: jnp.mean(a["n"]), lambda f, a: 3 + np.mean(a["n"])),
    "mean of squares": (lambda a: jnp.mean(a["m"] ** 2), lambda f, a: 4 + np.mean(a["m"] ** 2)),
    "sum of squares": (lambda a: jnp.sum(a["m"] ** 2), MANY),
    "sum of scaled": (lambda a: jnp.sum(a["n"] / 1000.0), lambda f, a: 3 * MANY + np.sum(a["n"]) / 1000),
    "cumulative sum of scaled": (
        lambda a: jnp.cumsum(a["n"] * 3e-7)[-1] * 0.5,
        lambda f, a: 2 + 1.5 * MANY + np.sum(a["n"]) * 3e-7,
    ),
    "sum of products by index": (lambda a: a["e"].at[np.zeros(6, int)].add(a["x"] * a["y"]), 6),
    # Products together.
    "difference of products": (lambda a: a["x"] * a["y"] - a["z"] * a["y"], 2),
    "four products": (lambda a: a["x"] * a["y"] + a["z"] * a["y"] + 2 * (a["x"] * a["y"]), 4),
    "a product of a negative product": (lambda a: -(a["x"] * a["y"]) - a["e"], 1),
    "selected products": (lambda a: jnp.where(a["b"], a["x"] * a["y"], a["z"] * a["y"]), 3),
    "joined": (lambda a: jnp.concatenate([a["x"] * a["y"], jnp.sum(a["n"])[None], a["e"]]), 1),
    "relu": (lambda a: jax.nn.relu(a["x"] * a["y"] + a["o"]), 1),
    "relu of a difference": (lambda a: jax.nn.relu(a["x"] * a["y"] - a["z"] * a["y"]), 1),
    "relu of a slice": (lambda a: jax.nn.relu((a["x"] * a["y"] + a["o"])[1:4]) * 0.5, 1),
    # Comparisons.
    "greater": (lambda a: a["x"] * a["y"] > a["z"] * a["y"], 0),
    "greater than a value": (lambda a: a["x"] * a["y"] > a["o"], 0),
    "equal": (lambda a: a["x"] * a["y"] == a["z"] * a["y"], 0),
    "sign": (lambda a: jnp.sign(a["x"] * a["y"] - a["o"]), 0),
    "maximum": (lambda a: jnp.maximum(a["x"] * a["y"], a["z"] * a["y"]), 1),
    "minimum": (lambda a: jnp.minimum(a["x"] * a["y"], a["z"] * a["y"]), 1),
    "minimum with 0": (lambda a: jnp.minimum(a["x"] * a["y"], 0.0), 1),
    "clip": (lambda a: jnp.clip(a["x"] * a["y"], a["o"][1] * -0.5, a["o"][0] * 0.5), 3),
    "absolute": (lambda a: jnp.abs(a["x"] * a["y"] - a["o"]), 1),
    "largest": (lambda a: jnp.max(a["x"] * a["y"] + a["o"]), 1),
    "arg max": (lambda a: jnp.argmax((a["x"] * a["y"] + a["o"])[::-1]), 0),
    # Public numbers that only the run knows, of any size beside a product.
    "public relu": (lambda a: jax.nn.relu(a["x"] * a["y"] + a["q"]), 1),
    "public relu of the negative": (lambda a: jax.nn.relu(a["q"] - a["x"] * a["y"]), 1),
    "public comparison": (lambda a: a["x"] * a["y"] + a["q"] > 0, 0),
    "public maximum": (lambda a: jnp.maximum(a["q"], a["x"] * a["y"]), 1),
    "public mask": (lambda a: jnp.argmax(a["x"] * a["y"] + a["q"]), 0),
    "public sum": (lambda a: (a["x"] * a["y"] + a["q"]) * 0.5, 1.5),
}


@cache
def results(parties, protocol):
    """All functions in one compilation."""

    @jax.jit
    def run(key, secret, known):
        step = cn.secure(
            lambda secret, known: {n: f(secret | known) for n, (f, _) in FUNCTIONS.items()}, protocol=protocol
        )
        shared = cn.share(jax.random.fold_in(key, 1), secret, parties=parties, protocol=protocol)
        return cn.reveal(step(key, shared, known))

    f = protocol.frac_bits
    return run(jax.random.key(f), arguments(f), public(f))


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize(("parties", "protocol"), CONTEXTS, ids=lambda x: str(x))
def test_what_stays_within_the_contract_is_right(name, parties, protocol):
    f = protocol.frac_bits
    function, bound = FUNCTIONS[name]
    given = arguments(f) | public(f)
    expected = np.asarray(function({name: jnp.asarray(x) for name, x in given.items()}), np.float64)
    error = np.abs(np.asarray(results(parties, protocol)[name], np.float64) - expected)
    assert error.shape == expected.shape
    bound = bound(f, given) if callable(bound) else bound
    # Float64 itself rounds in the last of 53 bits.
    assert np.max(error) <= bound * 2.0**-f + 1e-14 * np.max(np.abs(expected))
