"""What the parties see of one another: nothing but uniform words, whatever the secrets are.

The same two tests look at a network's transcript, and at leaks planted in small programs: these they must
find.
"""

import functools
import itertools
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ciphernav_jax as cn
from ciphernav_jax.parties import sharing
from ciphernav_jax.parties.party import open_sum
from ciphernav_jax.parties.recording import run_recorded
from ciphernav_jax.parties.requests import Mask, Request
from ciphernav_jax.protocols import masked

from ..parties.simulated import joint_uniformity
from .message_process import calls

pytestmark = pytest.mark.newest_jax

PARTIES = 3
RUNS = 1000
NEVER = 1e-9  # a p-value below it is a fault: there are some thousand tests


def network(x, w):
    """Products, truncations, and ReLU."""
    hidden = jax.nn.relu(x @ w)
    return hidden * hidden


network_observed = cn.transcript(cn.secure(network))
NETWORK_INPUTS = (
    (np.array([0.25, -0.5], np.float32), np.array([[1, 2], [-1, 0.5]], np.float32)),
    (np.array([1000.0, 3.0], np.float32), np.array([[-7, 0], [100, 1e-3]], np.float32)),
)


@dataclass(frozen=True)
class BiasedMask(Request):
    """A `Mask` whose lowest bit is 1 in three of four cases."""

    shape: tuple[int, ...]

    @property
    def uniform(self):
        return {"word": self.shape, "bit": self.shape}

    def deal(self, uniform, earlier):
        return {"mask": uniform["word"] | (uniform["bit"] & 1)}


def sound(dealer, x, y):
    return masked.open_masked(dealer, x).share(), masked.open_masked(dealer, y).share()


def reused(dealer, x, y):
    mask = dealer.take(Mask(x.shape))["mask"]
    return open_sum(x + mask), open_sum(y + mask)


def unmasked(dealer, x, y):
    return masked.open_masked(dealer, x).share(), open_sum(y)


def biased(dealer, x, y):
    return masked.open_masked(dealer, x).share(), open_sum(y + dealer.take(BiasedMask(y.shape))["mask"])


PROGRAMS = {program.__name__: program for program in (sound, reused, unmasked, biased)}
PROGRAM_INPUTS = tuple(np.arange(8, dtype=np.uint64).reshape(2, 4) * scale + 1 for scale in (1, 1000))


def program_messages(program, key, secrets):
    keys = jax.random.split(key, 3)
    shares = [sharing.share_ring(k, x, PARTIES) for k, x in zip(keys, secrets, strict=False)]
    alone = lambda dealer, private, _: (program(dealer, *private), None)  # noqa: E731
    return run_recorded(alone, keys[2], PARTIES, shares, None)[1]


def network_messages(key, secrets):
    keys = jax.random.split(key, 2)
    return network_observed(keys[0], *cn.share(keys[1], secrets, parties=PARTIES))[1]


@functools.cache
def seen(name):
    """For each of two inputs the messages of many runs: what is opened, and what each party sends, with the
    runs as leading axis. Every run has its own shares and its own randomness of the dealer.
    """
    if name == "network":
        messages, inputs = network_messages, NETWORK_INPUTS
    else:
        messages, inputs = functools.partial(program_messages, PROGRAMS[name]), PROGRAM_INPUTS
    runs = jax.jit(jax.vmap(lambda seed, secrets: messages(jax.random.key(seed), secrets), in_axes=(0, None)))
    return [jax.tree.map(np.asarray, runs(np.arange(RUNS) + i * RUNS, x)) for i, x in enumerate(inputs)]


def openings(messages):
    return [message.opened for message in messages]


def rows(messages):
    return [message.sent[:, party] for message in messages for party in range(PARTIES)]


def bits(x):
    """0 or 1 for each bit of the words of each run."""
    return np.unpackbits(np.ascontiguousarray(x).reshape(RUNS, -1).view(np.uint8), axis=1)


def features(messages):
    """All that is opened, what the first party sends, and how openings differ from each other, bit by bit."""
    opened = openings(messages)
    pairs = [(x, y) for x, y in itertools.combinations(opened, 2) if x.shape == y.shape]
    words = [*opened, *rows(messages)[::PARTIES], *(x - y for x, y in pairs), *(x ^ y for x, y in pairs)]
    return np.concatenate([bits(x) for x in words], axis=1).astype(np.float32) - 0.5


@jax.jit
def trained(x, y):
    """Logistic regression of labels in {-1, 1}, by gradient descent."""

    def loss(w):
        return jnp.mean(jnp.logaddexp(0.0, -y * (x @ w))) + 1e-3 * jnp.sum(w**2)

    return jax.lax.fori_loop(0, 100, lambda _, w: w - 0.3 * jax.grad(loss)(w), jnp.zeros(x.shape[1], x.dtype))


def told_apart(name):
    """The share of held-out runs of which the classifier names the input."""
    x = np.stack([features(messages) for messages in seen(name)], axis=1)  # [runs, 2, features]
    y = np.broadcast_to(np.array([-1, 1], np.float32), x.shape[:2])
    half = RUNS // 2
    w = trained(x[:half].reshape(RUNS, -1), y[:half].ravel())
    return np.mean(np.sign(x[half:] @ np.asarray(w)) == y[half:])


BY_CHANCE = 4 * 0.5 / np.sqrt(RUNS)  # four standard deviations of the mean of RUNS coins


def test_the_result_is_that_of_the_step():
    step, key, args = calls()["training step"]
    result, messages = cn.transcript(step)(key, *args)
    expected = step(key, *args)
    assert jax.tree.structure(result) == jax.tree.structure(expected)
    for x, y in zip(jax.tree.leaves(result), jax.tree.leaves(expected), strict=True):
        np.testing.assert_array_equal(x, y)
    counted = cn.cost(step, *args)
    assert tuple(message.opening for message in messages) == counted.openings
    assert sum(message.sent[0].nbytes for message in messages) == counted.bytes_sent


def test_messages_open_to_what_the_parties_send():
    for message in seen("network")[0]:
        join = np.add if message.opening.collective == "open_sum" else np.bitwise_xor
        np.testing.assert_array_equal(join.reduce(message.sent, axis=1), message.opened, err_msg=message.name)


def test_messages_say_what_they_are_for():
    names = [message.name for message in seen("network")[0]]
    assert names[:3] == ["dot_general/open_masked/open_sum"] * 2 + ["max/relu/open_sum"]
    assert names[3:9] == ["max/relu/open_xor"] * 6
    assert names[9:] == ["mul/open_masked/open_sum", "output/probabilistic/open_sum"]


@pytest.mark.parametrize("name", ["network", "sound"])
def test_every_message_is_uniform_whatever_the_secrets(name):
    for messages in seen(name):
        assert joint_uniformity(openings(messages)) > NEVER
        assert joint_uniformity(rows(messages)) > NEVER


@pytest.mark.parametrize("name", ["network", "sound"])
def test_a_classifier_cannot_tell_inputs_apart(name):
    assert abs(told_apart(name) - 0.5) < BY_CHANCE


@pytest.mark.parametrize("name", ["reused", "unmasked", "biased"])
def test_planted_leaks_are_found(name):
    for messages in seen(name):
        assert joint_uniformity(openings(messages)) < NEVER**3
    assert told_apart(name) > 0.5 + 2 * BY_CHANCE, told_apart(name)


def test_the_argument_in_place_of_a_key_is_refused():
    with pytest.raises(TypeError, match="dealer's random key"):
        network_observed(0, 1.0)
