"""Runs one party's program as all parties: compiled once for each program, number of parties and shape.

The programs of these tests are `program(dealer, *shares) -> shares`. Secrets are arrays of ring elements;
expected values are computed from Python's integers.
"""

import functools
import itertools

import jax
import numpy as np
from scipy import stats

from ciphernav_jax.parties import sharing
from ciphernav_jax.parties.recording import run_recorded
from ciphernav_jax.parties.run import run

from ..slow import slow

MODULUS = 2**64
PARTIES = [2, 3, 5]
BY_PARTIES = [3, *slow(2, 5)]
"""The same as a parameter of tests."""
EDGES = [0, 1, -1, 2, -2, 2**31, -(2**32), 2**62 - 1, -(2**62)]
WHOLE_RING = [*EDGES, 2**62, 2**63 - 1, -(2**63) + 1, -(2**62) - 1]


def elements(integers) -> np.ndarray:
    """Python's integers as ring elements."""
    return np.array([int(v) % MODULUS for v in np.ravel(integers)], np.uint64).reshape(np.shape(integers))


def signed(x) -> np.ndarray:
    return np.asarray(x).view(np.int64)


def words(seed: int, *shape: int) -> np.ndarray:
    """Ring elements, uniform but for a third that are edge values."""
    rng = np.random.default_rng(seed)
    x = rng.integers(0, MODULUS, shape, dtype=np.uint64)
    return np.where(rng.random(shape) < 1 / 3, rng.choice(elements(WHOLE_RING), shape), x)


def _shared(key, secrets, parties):
    """A key for the dealer, and fresh shares of the secrets."""
    keys = jax.random.split(key, len(secrets) + 1)
    return keys[0], [sharing.share_ring(k, x, parties) for k, x in zip(keys[1:], secrets, strict=True)]


def _alone(program):
    """The program with results that are all private."""
    return functools.wraps(program)(lambda dealer, private, _: (program(dealer, *private), None))


@functools.cache
def on_shares(program, parties: int):
    """Jitted (seed, *secrets) -> the program's results as shares, the party as leading axis."""

    def shares_of_results(seed, *secrets):
        key, shares = _shared(jax.random.key(seed), secrets, parties)
        return run(_alone(program), key, parties, shares, None)[0]

    return jax.jit(shares_of_results)


@functools.cache
def on_secrets(program, parties: int):
    """Jitted (seed, *secrets) -> the program's results, joined."""
    shares = on_shares(program, parties)
    return jax.jit(lambda seed, *secrets: jax.tree.map(sharing.join_sum, shares(seed, *secrets)))


def views(program, parties: int):
    """Jitted (seed, *secrets) -> all messages, in order."""

    def view(seed, *secrets):
        key, shares = _shared(jax.random.key(seed), secrets, parties)
        return run_recorded(_alone(program), key, parties, shares, None)[1]

    return jax.jit(view)


def uniformity(x) -> float:
    """The smallest p-value of chi-squared tests that each of the words' 16 hexadecimal digits is uniform."""
    octets = np.ravel(x).view(np.uint8).reshape(-1, 8) + 256 * np.arange(8)
    counts = np.bincount(octets.ravel(), minlength=2048).reshape(8, 16, 16)
    digits = np.concatenate([counts.sum(axis=1), counts.sum(axis=2)])
    expected = len(octets) / 16
    return float(stats.chi2.sf(np.max(np.sum((digits - expected) ** 2, axis=1)) / expected, 15))


def joint_uniformity(arrays) -> float:
    """The smallest p-value over arrays, differences of neighbouring entries, and of arrays of equal size."""
    flat = [np.ravel(x) for x in arrays]
    tried = [*flat, *(x[1:] - x[:-1] for x in flat), *(x[1:] ^ x[:-1] for x in flat)]
    for x, y in itertools.combinations(flat, 2):
        if x.size == y.size:
            tried += [x - y, x ^ y]
    return min(map(uniformity, tried))
