"""Variants of the protocols compared on a step of training, and trained with.

The paper has one: CrypTen's protocols as they are, here `truncation=wrap-count,frac_bits=16`.

    python -m experiments paper variants      # 20 minutes on two cores

A step of training the paper's classifier by `cn.compare`, with two parties in all variants and with more in
a few. Then what a single call does not show, with two parties:

- loss: of a training of 100 steps on one batch, which a random network has labelled, and the same in float64.
  Errors of each step add up in the weights, so that a small bias shows where a single result looks right.
- failures: of a million single truncations of products of 30,000, or of half a variant's bound if less.

OUT/variants/comparison.json, comparison.md, comparison.png   what `cn.compare` leaves
OUT/variants/trained.json                                     the trainings; killed, the same command goes on
RESULTS/variants.json                                         both
"""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from numpy.typing import NDArray

from ciphernav_jax import files, provenance, tables
from ciphernav_jax.command_line import read
from ciphernav_jax.comparison import Comparison, compare
from ciphernav_jax.files import read_json, write_json
from ciphernav_jax.models.classifier import ACTIONS
from ciphernav_jax.navigation import classifier
from ciphernav_jax.navigation.classifier import FreshClassifier
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.ring import keys
from ciphernav_jax.secret import reveal, secure, share
from experiments.failures import failures
from experiments.paper.runs import Options, console

# The ripple adder is left out: 63 rounds.
VARIANTS = (
    "default",
    "truncation=nearest",
    "truncation=floor",
    "truncation=wrap-count",
    "truncation=local",
    "frac_bits=16",
    "truncation=floor,frac_bits=16",
    "truncation=wrap-count,frac_bits=16",
    "comparison=masked-words",
    "comparison=resharing",
    "adder=kogge-stone",
    "adder=brent-kung",
    "range_bits=16",
    "generator=chacha20",
    "multiplication=ideal",
    "multiplication=ideal,truncation=ideal,comparison=ideal",
)
FEW = ("default", "truncation=wrap-count", VARIANTS[-1])
PLAN = (((2,), VARIANTS), ((3, 5), (*FEW, "comparison=resharing")), ((8,), FEW))
"""Which numbers of parties with which variants."""

PARTIES = 2
"""Of the trainings and of the single truncations."""
STEPS = 100
VALUE = 30_000.0
TRUNCATIONS = (16, 1 << 16)
"""How often, and how many at once."""

Floats = NDArray[np.floating[Any]]


def compared(out: Path, recipe: FreshClassifier, plan: Any = PLAN) -> Comparison:
    """A step of training with every variant of the plan; what `out` holds is kept."""
    step, given = classifier.training_step(recipe)
    # How far the rate has fallen is public; a step has its gradient among its values.
    asked: dict[str, Any] = {"public": (3,), "gradients": False, "out": out}
    return [
        compare(step, *given, parties=parties, protocols=list(map(Protocol.parse, variants)), **asked)
        for parties, variants in plan
    ][-1]  # each adds to what the others left


def trained(protocol: Protocol, recipe: FreshClassifier, steps: int = STEPS) -> dict[str, Any]:
    """Losses of a training and failures of truncations.

    Returns:
        protocol, ideal, parties; steps; loss, of the last step, and exact, the same in float64; value,
        truncations and failed.
    """
    args = taught(recipe)
    key = keys.derive(keys.root(0), "variants", str(protocol), recipe.batch, steps)
    value = min(VALUE, protocol.bound / 2)
    failed, of = failures(protocol, PARTIES, value, *TRUNCATIONS)
    return {
        "protocol": str(protocol),
        "ideal": protocol.ideal,
        "parties": PARTIES,
        "steps": steps,
        "loss": float(losses(args, recipe, protocol, steps, key)[-1]),
        "exact": float(exactly(args, recipe, steps)[-1]),
        "value": value,
        "truncations": of,
        "failed": failed,
    }


def taught(recipe: FreshClassifier) -> tuple[Any, Any, Any]:
    """Weights with their velocity, and a batch of slots and labels."""
    _, ((weights, velocity, _), slots, _, _) = classifier.training_step(recipe)
    answers = np.asarray(classifier.predict(classifier.initial(1), slots))
    # Without their means, a random network's answers are nearly the same for all inputs.
    answers = (answers - answers.mean(axis=0)) / answers.std(axis=0)
    return (weights, velocity), slots, np.eye(ACTIONS, dtype=np.float32)[np.argmax(answers, axis=1)]


def losses(
    args: tuple[Any, Any, Any], recipe: FreshClassifier, protocol: Protocol, steps: int, key: Array
) -> Floats:
    """float[steps]: the loss of each step of a training on shares."""
    shared = share(keys.derive(key, "share"), args, parties=PARTIES, protocol=protocol)
    step = secure(_step(recipe), protocol=protocol)

    @jax.jit
    def run(of_steps: Array, state: Any, *batch: Any) -> Any:
        return lax.scan(lambda state, key: step(key, state, *batch), state, of_steps)[1]

    return np.asarray(reveal(run(keys.derive(key, "step", np.arange(steps)), *shared)))


def exactly(args: tuple[Any, Any, Any], recipe: FreshClassifier, steps: int) -> Floats:
    """The same in float64."""
    step = _step(recipe)

    @jax.jit
    def run(state: Any, *batch: Any) -> Array:
        return lax.scan(lambda state, _: step(state, *batch), state, length=steps)[1]

    with jax.numpy_dtype_promotion("standard"):  # the rate is a float32
        return np.asarray(run(*jax.tree.map(lambda x: np.asarray(x, np.float64), args)))


def _step(recipe: FreshClassifier) -> Any:
    """A step of training at a constant rate: the next weights with their velocity, and the loss before it."""
    advance, _ = classifier.training_step(recipe)

    def step(state: Any, slots: Any, labels: Any) -> Any:
        *state, loss = advance((*state, np.float32(0)), slots, labels, jnp.float32(1))
        return tuple(state), loss

    return step


def trainings(path: Path, recipe: FreshClassifier, variants: tuple[str, ...] = VARIANTS) -> list[dict]:
    """Of `trained` each variant's; those that the file at `path` holds are kept."""
    made = {"batch": recipe.batch, "versions": provenance.versions(), "machine": provenance.machine()}
    document = read_json(path) if path.exists() else made | {"trained": []}
    if any(document[name] != value for name, value in made.items()):
        raise files.DamagedError(f"{path} is of another batch, machine or version; remove it to start anew")
    kept = {of["protocol"] for of in document["trained"]}
    with tables.progress(console) as progress:
        task = progress.add_task("", total=len(variants))
        for protocol in map(Protocol.parse, variants):
            progress.update(task, description=f"{protocol}: training")
            if str(protocol) not in kept:
                document["trained"].append(trained(protocol, recipe))
                write_json(path, document)
            progress.advance(task)
    return document["trained"]


def main() -> None:
    """Compare, train, print and write."""
    args = read(Options(), __doc__)
    recipe, out = FreshClassifier(), args.out / "variants"
    comparison = compared(out, recipe)
    console.print(comparison)
    with files.claimed(out):
        found = trainings(out / "trained.json", recipe)
    for of in found:
        console.print(
            f"{of['protocol']}: loss {of['loss']:.6g}, in float64 {of['exact']:.6g}; "
            f"{of['failed']} of {of['truncations']:,} truncations failed"
        )
    document = {
        "versions": provenance.versions(),
        "machine": provenance.machine(),
        "at": provenance.now(),
        "comparison": comparison.as_dict(),
        "trained": found,
    }
    write_json(args.results / "variants.json", document)
