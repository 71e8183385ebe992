"""Training a network on a table, in plaintext or under secret sharing.

Both run the same ordinary JAX function, `sgd_step`. Under secret sharing every owner shares its columns
once, the weights are shared from the start and never opened, and all that comes out is the loss, summed over
a chunk of steps, and how many samples of the chunk's last batch are answered rightly.
"""

import functools
import time
from collections.abc import Callable, Sized
from dataclasses import asdict
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ciphernav_jax import files
from ciphernav_jax.learning.columns import SplitTable, picked
from ciphernav_jax.learning.progress import Report
from ciphernav_jax.learning.sgd import Model, Sgd, count_right, sgd_step
from ciphernav_jax.learning.storage import Checkpoint, fingerprint
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.ring import keys
from ciphernav_jax.secret import Secret, audit, fresh, reveal, secure, share


def fit(
    model: Model,
    weights: Any,
    table: SplitTable,
    recipe: Sgd,
    key: jax.Array,
    *,
    seed: int = 0,
    parties: int | None = None,
    protocol: Protocol | None = None,
    checkpoint: Checkpoint | None = None,
    report: Report | None = None,
) -> tuple[Any, list[dict]]:
    """Train a network, or go on from the latest checkpoint: the same to the bit.

    Args:
        model: what is trained.
        weights: a pytree of public float arrays of one dtype, which is the columns' too, to start with.
        table: the columns, each with its owner.
        recipe: how to train.
        key: of this training and no other: of the shares and the dealer, where there are parties.
        seed: of the batches, which are public.
        parties: how many share the secrets; None trains in plaintext.
        protocol: the variants; None for the default.
        checkpoint: kept after the latest chunk of steps; of a secret it holds the shares. None keeps nothing.
            That of other arguments is refused, but for `predict`, which nobody can compare.
        report: called after each chunk.

    Returns:
        The weights, secret if there are parties, and the curve: for each chunk a dict of step, mean
        loss, accuracy on its last batch in percent, after its update (of a single output there is none), and
        the seconds that it took; in `compile_seconds`, what compiling took before it. Of a secret training
        the sum of a chunk's losses and that count of right answers are opened, nothing else; truncations, and
        how many of them failed, are what the simulation knows besides (`secret.audit`).

    Raises:
        ValueError: fewer than two parties, or fewer than owners; a batch of more samples than there are; what
            `predict` gives, or an answer, is not float[batch, outputs].
        TypeError: no key.
        DamagedError: the checkpoint is not what was written, or another training's.

    Warns:
        KeyReuseWarning: the key was given to another training in secret.

    Example:
        >>> import jax, jax.numpy as jnp, numpy as np
        >>> from ciphernav_jax.learning import Column, Model, Sgd, SplitTable, fit
        >>> rng = np.random.default_rng(0)
        >>> left, right = rng.normal(size=(2, 40, 1)).astype(np.float32)
        >>> answers = np.eye(2, dtype=np.float32)[(left + right > 0).astype(int)[:, 0]]
        >>> table = SplitTable(
        ...     {"left": Column("one", left), "right": Column("two", right)}, answers=Column("two", answers)
        ... )
        >>> model = Model(lambda w, columns: jnp.concatenate(columns, axis=1) @ w, outputs=2)
        >>> recipe = Sgd(steps=40, batch=40, learning_rate=0.5, chunk=20)
        >>> start = jnp.zeros((2, 2), jnp.float32)
        >>> weights, curve = fit(model, start, table, recipe, jax.random.key(0), parties=2)
        >>> weights.parties, [point["step"] for point in curve], curve[-1]["accuracy"] > 90
        (2, [20, 40], True)
    """
    require_batch(recipe, table)
    _require_outputs(model, weights, table, recipe.batch)
    fresh.require_key(key, "fit", "the key")
    state, data = at_start(weights), table.values
    dtype = jnp.result_type(*jax.tree.leaves((weights, data)))
    protocol = None if parties is None else protocol or Protocol()
    if checkpoint is not None:
        rows = [column.rows for column in (*table.columns.values(), table.answers)]
        decided_by = {
            "arrays": fingerprint((jax.random.key_data(keys.typed(key)), weights, data, rows)),
            "recipe": asdict(recipe),
            "seed": seed,
            "parties": parties,
            "protocol": protocol and asdict(protocol),
        }
        checkpoint = checkpoint.also(files.canonical(decided_by))
    if parties is not None:
        fresh.of_each_call(key, (weights, data), "fit", how=(model, recipe, seed, parties, protocol))
        state, data = share_at_start(key, weights, table, parties, protocol)

    done, curve = 0, []
    if checkpoint is not None:
        done, state, curve = checkpoint.restore(state)
    compiled: dict[int, Any] = {}
    began = time.perf_counter()
    while done < recipe.steps:
        steps = np.arange(done, min(done + recipe.chunk, recipe.steps))
        total = jnp.zeros((), dtype)  # its buffer is given away with the state's
        if parties is not None:
            total = share_loss(key, done, total, parties, protocol)
        args = (key, (*state, total), data, table.batches(recipe, seed, steps))
        timing = {}
        if len(steps) not in compiled:  # the last chunk may be shorter
            before = time.perf_counter()
            compiled[len(steps)] = _run.lower(*args, model, recipe, protocol).compile()
            timing["compile_seconds"] = time.perf_counter() - before
            began += timing["compile_seconds"]
        (*state, total), right, truncations = compiled[len(steps)](*args)
        done += len(steps)
        point = {
            "step": done,
            "loss": float(reveal(total)) / (len(steps) * recipe.batch * model.outputs),
        }
        if model.outputs > 1:
            point["accuracy"] = 100 * float(reveal(right)) / recipe.batch
        if parties is not None:
            point |= dict(zip(("truncations", "failed"), map(int, truncations), strict=True))
        began, seconds = time.perf_counter(), time.perf_counter() - began
        curve = [*curve, point | timing | {"seconds": seconds}]
        if checkpoint is not None:
            checkpoint.save(done, tuple(state), curve)
        if report is not None:
            report(done, recipe.steps, curve[-1])
    return state[0], curve


def require_batch(recipe: Sgd, samples: Sized) -> None:
    """Raises ValueError if there are fewer samples than a batch has."""
    if recipe.batch > len(samples):
        raise ValueError(
            f"a batch of {recipe.batch:,} is more than the {len(samples):,} samples that there are; choose a "
            "smaller batch, or a larger data set"
        )


def _require_outputs(model: Model, weights: Any, table: SplitTable, batch: int) -> None:
    """Raises ValueError where outputs and answers would be broadcast against one another."""
    shapes = [
        jax.ShapeDtypeStruct((batch, *x.shape[1:]), x.dtype)
        for x in (column.values for column in (*table.columns.values(), table.answers))
    ]
    *columns, answers = shapes
    found = jax.eval_shape(model.predict, weights, tuple(columns))
    for what, shape in (("predict gives", found.shape), ("an answer is", answers.shape)):
        if shape != (batch, model.outputs):
            raise ValueError(
                f"{what} float{list(shape)} for a batch of {batch}, and not [{batch}, {model.outputs}], as "
                f"outputs={model.outputs} says"
            )


@functools.partial(jax.jit, static_argnames=("model", "recipe", "protocol"), donate_argnames="state")
def _run(
    key: jax.Array,
    state: tuple,
    data: tuple,
    batches: tuple,
    model: Model,
    recipe: Sgd,
    protocol: Protocol | None,
):
    """A chunk of steps as one loop; a step's randomness comes from its number, wherever the chunk began.

    Without a protocol it runs in the clear.

    Returns:
        The next state, the right answers of the last batch, and the truncations and those that failed.
    """
    evaluate = functools.partial(_secretly, protocol) if protocol else _openly
    advance = evaluate(functools.partial(sgd_step, model, recipe=recipe))
    count = evaluate(functools.partial(count_right, model))

    def body(carry, batch):
        state, truncations = carry
        step, decay, rows = batch
        state, more = advance(step_key(key, step), state, *picked(data, rows), decay)
        return (state, jax.tree.map(jnp.add, truncations, more)), None

    (state, truncations), _ = jax.lax.scan(body, (state, NO_TRUNCATIONS), batches)
    last, _, rows = jax.tree.map(lambda each: each[-1], batches)
    if model.outputs == 1:
        return state, None, truncations
    right, more = count(keys.derive(key, "right answers", last), state[0], *picked(data, rows))
    return state, right, jax.tree.map(jnp.add, truncations, more)


NO_TRUNCATIONS = (np.int64(0), np.int64(0))


def _secretly(protocol: Protocol, function: Callable[..., Any]) -> Callable[..., Any]:
    return audit(secure(function, protocol=protocol))


def _openly(function: Callable[..., Any]) -> Callable[..., Any]:
    return lambda _, *args: (function(*args), NO_TRUNCATIONS)


def at_start(weights: Any) -> tuple[Any, Any]:
    """Weights and velocity before the first step; copies, for a step gives its buffers away."""
    return jax.tree.map(jnp.array, weights), jax.tree.map(jnp.zeros_like, weights)


def share_at_start(
    key: jax.Array, weights: Any, table: SplitTable, parties: int, protocol: Protocol | None = None
) -> tuple[tuple, tuple]:
    """All that is shared before the first step of the training that has this key: weights and velocity, and
    the table.
    """
    state = share(keys.derive(key, "weights"), at_start(weights), parties=parties, protocol=protocol)
    return state, table.shared(keys.derive(key, "data"), parties, protocol)


def share_loss(
    key: jax.Array, done: int, zero: jax.Array, parties: int, protocol: Protocol | None = None
) -> Secret:
    """The 0 to which the losses of a chunk are added; so many steps are done before it."""
    return share(keys.derive(key, "loss", done), zero, parties=parties, protocol=protocol)


def step_key(key: jax.Array, step: int | jax.Array) -> jax.Array:
    """The key of one step of the training that has this key."""
    return keys.derive(key, "step", step)
