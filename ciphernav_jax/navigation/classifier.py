"""A fresh action classifier on frozen features, in plaintext or under secret sharing.

Both run the same ordinary JAX function, `sgd_step`. Under secret sharing every party shares the
slots it owns once, the weights are shared from the start and never opened, and all that comes out
is the loss, summed over a chunk of steps, and how many samples of the chunk's last batch are answered
rightly.
"""

import functools
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx
from numpy.typing import NDArray

from ciphernav_jax.models import ActionClassifier
from ciphernav_jax.models.classifier import ACTIONS
from ciphernav_jax.navigation.features import Features
from ciphernav_jax.navigation.parties import SLOTS, cast
from ciphernav_jax.navigation.plain import Report
from ciphernav_jax.navigation.samples import Samples
from ciphernav_jax.navigation.storage import Checkpoint
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.ring import keys
from ciphernav_jax.secret import Secret, audit, reveal, secure, share

GRAPH = nnx.split(ActionClassifier(nnx.Rngs(0)))[0]


@dataclass(frozen=True)
class FreshClassifier:
    """How to train the classifier: SGD with momentum on the squared loss."""

    steps: int = 1060
    """Steps, a batch each."""
    batch: int = 500
    """Samples per step."""
    learning_rate: float = 0.6
    """For the mean squared error; taken to the power of two nearest in the update."""
    momentum: float = 0.9
    """Part of the velocity that is kept at each step."""
    schedule: Literal["linear", "constant"] = "linear"
    """Whether the learning rate falls to 0 in a straight line, or stays."""
    standardised: bool = True
    """Whether each owner standardises the features of its slots before it shares them."""
    errands: int = 0
    """Further paths in every environment to train on, to goals of the robot's own choice (the paper: 0)."""
    stray: float = 0.0
    """How often a robot on an errand takes any move instead of the right one."""
    chunk: int = 53
    """Steps between checkpoints; they run as one compiled loop."""

    @property
    def scale(self) -> float:
        """What the gradient of the summed loss is multiplied by: a power of two.

        The loss is kept as a sum, whose gradients are far from the resolution of fixed point, and
        the mean's 1 / (batch * 5) goes into the rate; a power of two makes it a mere shift.
        """
        return 2.0 ** round(np.log2(self.learning_rate / (self.batch * ACTIONS)))


def predict(params: Any, slots: tuple) -> jax.Array:
    """The five logits, float32[n, 5], from the six slots of the input, float32[n, 32 or 128]."""
    return nnx.merge(GRAPH, params)(jnp.concatenate(slots, axis=-1))


def count_right(params: Any, slots: tuple, labels: jax.Array) -> jax.Array:
    """float32: for how many samples the largest logit is the right action's."""
    right = jnp.argmax(predict(params, slots), axis=-1) == jnp.argmax(labels, axis=-1)
    return jnp.sum(right.astype(jnp.float32))


def initial(seed: int) -> dict:
    """Random public weights of a fresh classifier, as a dict of float32 arrays."""
    return nnx.to_pure_dict(nnx.split(ActionClassifier(nnx.Rngs(seed)))[1])


def sgd_step(state: tuple, slots: tuple, labels: jax.Array, decay: jax.Array, recipe: FreshClassifier):
    """One step. Ordinary JAX: `secure` turns it into a protocol as it stands.

    Args:
        state: weights and velocity, two pytrees of the same shape, and the loss summed so far.
        slots: the batch's six slots.
        labels: float32[n, 5], one-hot actions.
        decay: float32 scalar, public, by which the rate has fallen.
        recipe: the scale and the momentum.

    Returns:
        The next state; the loss is the squared error summed over samples and actions.
    """
    params, velocity, total = state

    def error(params):
        return jnp.sum(jnp.square(predict(params, slots) - labels))

    loss, gradient = jax.value_and_grad(error)(params)
    velocity = jax.tree.map(lambda v, g: recipe.momentum * v - decay * (recipe.scale * g), velocity, gradient)
    return jax.tree.map(jnp.add, params, velocity), velocity, total + loss


def train(
    features: Features,
    samples: Samples,
    recipe: FreshClassifier,
    seed: int,
    key: jax.Array,
    checkpoint: Checkpoint,
    report: Report,
    parties: int | None = None,
    protocol: Protocol | None = None,
) -> tuple[Any, list[dict]]:
    """Train a fresh classifier, or go on from the latest checkpoint: the same to the bit.

    Args:
        features: of the training environments, standardised if the recipe says so.
        samples: the training samples.
        recipe: how to train.
        seed: of the public weights and of the batches.
        key: of this training and no other: of the shares and the dealer, where there are parties.
        checkpoint: kept after the latest chunk of steps; of a secret it holds the shares.
        report: called after each chunk.
        parties: how many share the secrets; None trains in plaintext.
        protocol: the variants; None for the default.

    Returns:
        The weights, secret if there are parties, and the curve: for each chunk a dict of step, mean
        loss, accuracy on its last batch in percent, after its update, and the seconds that it took; in
        `compile_seconds`, what compiling took before it. Of a secret training the sum of a chunk's losses
        and that count of right answers are opened, nothing else; truncations, and how many of them failed,
        are what the simulation knows besides (`secret.audit`).

    Raises:
        ValueError: fewer than two parties.
    """
    state, data = at_start(features, samples, seed)
    protocol = None if parties is None else protocol or Protocol()
    if parties is not None:
        state, data = share_at_start(key, state, data, parties, protocol)

    done, state, curve = checkpoint.restore(state)
    compiled: dict[int, Any] = {}
    began = time.perf_counter()
    while done < recipe.steps:
        steps = np.arange(done, min(done + recipe.chunk, recipe.steps))
        total = jnp.float32(0)
        if parties is not None:
            total = share_loss(key, done, parties, protocol)
        args = (key, (*state, total), data, batches(samples, recipe, seed, steps))
        timing = {}
        if len(steps) not in compiled:  # the last chunk may be shorter
            before = time.perf_counter()
            compiled[len(steps)] = _run.lower(*args, recipe, protocol).compile()
            timing["compile_seconds"] = time.perf_counter() - before
            began += timing["compile_seconds"]
        (*state, total), right, truncations = compiled[len(steps)](*args)
        done += len(steps)
        point = {
            "step": done,
            "loss": float(reveal(total)) / (len(steps) * recipe.batch * ACTIONS),
            "accuracy": 100 * float(reveal(right)) / recipe.batch,
        }
        if parties is not None:
            point |= dict(zip(("truncations", "failed"), map(int, truncations), strict=True))
        began, seconds = time.perf_counter(), time.perf_counter() - began
        curve = [*curve, point | timing | {"seconds": seconds}]
        checkpoint.save(done, tuple(state), curve)
        report(done, recipe.steps, curve[-1])
    return state[0], curve


@functools.partial(jax.jit, static_argnames=("recipe", "protocol"), donate_argnames="state")
def _run(
    key: jax.Array,
    state: tuple,
    data: tuple,
    batches: tuple,
    recipe: FreshClassifier,
    protocol: Protocol | None,
):
    """A chunk of steps as one loop; a step's randomness comes from its number, wherever the chunk began.

    Without a protocol it runs in the clear.

    Returns:
        The next state, the right answers of the last batch, and the truncations and those that failed.
    """
    evaluate = functools.partial(_secretly, protocol) if protocol else _openly
    advance, count = evaluate(functools.partial(sgd_step, recipe=recipe)), evaluate(count_right)

    def body(carry, batch):
        state, truncations = carry
        step, decay, env, row = batch
        state, more = advance(step_key(key, step), state, *of_batch(data, env, row), decay)
        return (state, jax.tree.map(jnp.add, truncations, more)), None

    (state, truncations), _ = jax.lax.scan(body, (state, NO_TRUNCATIONS), batches)
    last, _, env, row = (each[-1] for each in batches)
    right, more = count(keys.derive(key, "right answers", last), state[0], *of_batch(data, env, row))
    return state, right, jax.tree.map(jnp.add, truncations, more)


NO_TRUNCATIONS = (np.int64(0), np.int64(0))


def _secretly(protocol: Protocol, function: Callable[..., Any]) -> Callable[..., Any]:
    return audit(secure(function, protocol=protocol))


def _openly(function: Callable[..., Any]) -> Callable[..., Any]:
    return lambda _, *args: (function(*args), NO_TRUNCATIONS)


def one_hot(samples: Samples) -> NDArray[np.float32]:
    """float32[S, 5]: the right actions."""
    return np.eye(ACTIONS, dtype=np.float32)[samples.action]


def at_start(features: Features, samples: Samples, seed: int) -> tuple[tuple, tuple]:
    """What `train` starts with, in the clear: weights and velocity, and the cameras', the robot's slots and
    labels.
    """
    weights = initial(seed)
    robot = features.robot(samples.env, samples.cell, samples.heading, samples.goal)
    return (weights, jax.tree.map(jnp.zeros_like, weights)), (features.cameras, robot, one_hot(samples))


def share_at_start(
    key: jax.Array, state: tuple, data: tuple, parties: int, protocol: Protocol | None = None
) -> tuple[tuple, tuple]:
    """All that is shared before the first step of the training that has this key; see `at_start`."""
    state = share(keys.derive(key, "weights"), state, parties=parties, protocol=protocol)
    return state, share_training_data(keys.derive(key, "data"), data, parties, protocol)


def share_loss(key: jax.Array, done: int, parties: int, protocol: Protocol | None = None) -> Secret:
    """The 0 to which the losses of a chunk are added; so many steps are done before it."""
    return share(keys.derive(key, "loss", done), jnp.float32(0), parties=parties, protocol=protocol)


def step_key(key: jax.Array, step: int | jax.Array) -> jax.Array:
    """The key of one step of the training that has this key."""
    return keys.derive(key, "step", step)


def batches(samples: Samples, recipe: FreshClassifier, seed: int, steps: NDArray[np.int64]) -> tuple:
    """Of each step its number, by how much the rate has fallen, and its samples' environments and rows; all
    public.
    """
    rows = np.stack([_batch_rows(step, len(samples), recipe.batch, seed) for step in steps.tolist()])
    decay = (1 - steps / recipe.steps * (recipe.schedule == "linear")).astype(np.float32)
    return steps, decay, samples.env[rows], rows


def of_batch(data: tuple, env: Any, row: Any) -> tuple[tuple, Any]:
    """The six slots of a batch, and its labels."""
    cameras, robot, labels = data
    return (*(camera[env] for camera in cameras), *(slot[row] for slot in robot)), labels[row]


def share_training_data(key: jax.Array, data: tuple, parties: int, protocol: Protocol | None = None) -> tuple:
    """Each owner shares its slots once, with randomness of its own; the robot shares the labels too."""
    cameras, robot, labels = data
    slots = dict(zip(SLOTS, (*cameras, *robot), strict=True))
    shared = {}
    owners = cast(parties)
    for party in owners:
        for slot in party.slots:
            own = keys.derive(key, party.name, slot)
            shared[slot] = share(own, slots[slot], parties=parties, protocol=protocol)
    *shared_cameras, view, place = (shared[slot] for slot in SLOTS)
    labels = share(keys.derive(key, owners[0].name, "labels"), labels, parties=parties, protocol=protocol)
    return tuple(shared_cameras), (view, place), labels


def _batch_rows(step: int, count: int, batch: int, seed: int) -> NDArray[np.int64]:
    # Public: each epoch is a permutation of the samples, cut into batches, the remainder left out.
    epoch, place = divmod(step, max(1, count // batch))
    return _order(epoch, count, seed)[np.arange(place * batch, (place + 1) * batch) % count]


@functools.lru_cache(maxsize=1)  # permuting all samples takes a third as long as a secret step
def _order(epoch: int, count: int, seed: int) -> NDArray[np.int64]:
    return np.random.default_rng([seed, epoch]).permutation(count)
