"""One protocol with one number of parties: its time, its cost, and its errors in a training.

`python -m experiments.trial ORDER.json RESULT.json`; `sweep` starts it.
"""

from dataclasses import asdict, dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from ciphernav_jax.protocols import Protocol
from ciphernav_jax.ring import keys
from ciphernav_jax.secret import LAN, WAN, Cost, cost, reveal, secure, share
from experiments import process
from experiments.failures import failures
from experiments.measure import calls, compiled, peak_bytes, summary, timed
from experiments.training import (
    Training,
    gradient_of_first_step,
    largest_sign_input,
    sgd_step,
    training,
)
from experiments.work import Sizes, forward

# A result farther from float64 than this is no rounding: a truncation or a sign has failed.
FAR = 1.0


@dataclass(frozen=True)
class Effort:
    """How much to try of each protocol."""

    sizes: Sizes = field(default_factory=Sizes)
    """Of the network, the batch of a training step and that of a forward pass."""
    steps: int = 100
    """After which the loss is compared; a multiple of `chunk`."""
    chunk: int = 10
    """Steps run, and timed, as one loop."""
    time_limit: float = 15.0
    """Seconds: no training where the first step lets expect a longer one. Its steps are then timed alone."""
    truncations: int = 1 << 20
    """Single truncations in which failures are counted; a multiple of 2^16, or less than that."""
    value: float = 30_000.0
    """Magnitude of the products that these truncate, or half the protocol's bound where this is less."""


@dataclass(frozen=True)
class Trial:
    """What to try."""

    protocol: Protocol
    parties: int
    effort: Effort = field(default_factory=Effort)
    seed: int = 0

    def as_json(self) -> dict[str, Any]:
        return asdict(self)

    @staticmethod
    def from_json(order: dict[str, Any]) -> "Trial":
        effort = order["effort"]
        return Trial(
            Protocol(**order["protocol"]),
            order["parties"],
            Effort(**effort | {"sizes": Sizes.from_json(effort["sizes"])}),
            order["seed"],
        )


def result_of(trial: Trial) -> dict[str, Any]:
    """Trace, compile, time, and compare with float64; in that order the forward pass and the training.

    Returns:
        forward, step: trace_s, compile_s, seconds (`measure.summary`), cost (rounds, bytes_sent,
        bytes_dealt, lan_s, wan_s; None where a variant is ideal). outputs, gradients: largest and rms error
        and how many of how many are `FAR`. curve: after every chunk the step and the losses, ours and in
        float64; None where the training would take too long. diverged: whether a loss or a weight is not
        finite or FAR (None too). truncations: failed, of, value. largest_sign_input: in float64,
        in_range: whether it is within the protocol's range_bits.
        peak_bytes.
    """
    plain = training(trial.effort.sizes, trial.seed)
    key = keys.derive(keys.root(trial.seed), "trial", str(trial.protocol), trial.parties, repr(trial.effort))
    passed, outputs = _forward(trial, plain, keys.derive(key, "forward"))
    trained, learned = _train(trial, plain, keys.derive(key, "training"))
    effort = trial.effort
    value = min(effort.value, trial.protocol.bound / 2)
    count = min(effort.truncations, 1 << 16)
    failed, of = failures(
        trial.protocol, trial.parties, value, effort.truncations // count, count, trial.seed
    )
    range_bits = trial.protocol.range_bits
    return {
        "forward": passed,
        "step": trained,
        "outputs": outputs,
        **learned,
        "in_range": range_bits is None or learned["largest_sign_input"] < 2**range_bits,
        "truncations": {"failed": failed, "of": of, "value": value},
        "peak_bytes": peak_bytes(),
    }


def _forward(trial: Trial, plain: Training, key: Array) -> tuple[dict[str, Any], dict[str, Any]]:
    share_key, call_key = keys.derive(key, "share"), keys.derive(key, "call")
    args = share(share_key, (plain.weights, plain.inputs), parties=trial.parties, protocol=trial.protocol)
    secured = secure(forward, protocol=trial.protocol)
    run, passed = compiled(secured, call_key, *args)
    jax.block_until_ready(run(call_key, *args))
    expected = forward(plain.weights, jnp.asarray(plain.inputs))
    times, errors = [], []
    for seconds, found in calls(run, call_key, args):
        times.append(seconds)
        errors.append(np.ravel(reveal(found) - expected))
    return (
        passed | {"seconds": summary(times), "cost": _cost(cost(secured, *args))},
        _errors(np.concatenate(errors)),
    )


def _train(trial: Trial, plain: Training, key: Array) -> tuple[dict[str, Any], dict[str, Any]]:
    effort = trial.effort
    share_key, first_key, call_key = (keys.derive(key, use) for use in ("share", "first step", "call"))
    state, features, labels = share(
        share_key, (plain.state, plain.features, plain.labels), parties=trial.parties, protocol=trial.protocol
    )
    secured = secure(sgd_step, protocol=trial.protocol)

    def loop(key: Array, state: Any, count: Array, features: Any, labels: Any) -> Any:
        # The number of steps is an argument: one compiled loop serves for the first step and for a chunk.
        of_steps = keys.derive(key, "step")

        def step(i: Array, state: Any) -> Any:
            return secured(keys.derive(of_steps, i), state, features, labels)

        return lax.fori_loop(0, count, step, state)

    batch = jnp.asarray(plain.features), jnp.asarray(plain.labels)

    @jax.jit
    def in_float64(state: Any, count: Array) -> Any:
        return lax.fori_loop(0, count, lambda _, s: sgd_step(s, *batch), state)

    one, chunk = jnp.int32(1), jnp.int32(effort.chunk)
    run, trained = compiled(loop, first_key, state, one, features, labels)
    warm = jax.block_until_ready(run(first_key, state, one, features, labels))
    exact = in_float64(plain.state, one)
    found, expected = (
        np.concatenate([np.ravel(g) for g in jax.tree.leaves(gradient_of_first_step(s, plain.labels.size))])
        for s in (reveal(warm), exact)
    )
    seconds, _ = timed(run, call_key, state, one, features, labels)
    learned: dict[str, Any] = {
        "gradients": _errors(found - expected),
        "curve": None,
        "diverged": None,
        "largest_sign_input": largest_sign_input(plain.weights, batch[0]),
    }
    times = [seconds]
    if seconds * effort.steps > effort.time_limit:
        times += [
            timed(run, keys.derive(call_key, "again", i), state, one, features, labels)[0] for i in (0, 1)
        ]
    else:
        times, curve, exact = [], [], plain.state
        for done in range(0, effort.steps, effort.chunk):
            key = keys.derive(call_key, "chunk", done)
            seconds, state = timed(run, key, state, chunk, features, labels)
            times.append(seconds / effort.chunk)
            exact = in_float64(exact, chunk)
            curve.append([done + effort.chunk, float(reveal(state[2])), float(exact[2])])
            learned["largest_sign_input"] = max(
                learned["largest_sign_input"], largest_sign_input(exact[0], batch[0])
            )
        deviations = jax.tree.map(lambda a, b: np.max(np.abs(a - b)), reveal(state), exact)
        # The loss is a sum, far from 0 at first: it counts as part of float64's.
        off = [float(d) for d in jax.tree.leaves(deviations[:2])] + [abs(curve[-1][1] / curve[-1][2] - 1)]
        learned |= {"curve": curve, "diverged": not all(d <= FAR for d in off)}
    return trained | {
        "seconds": summary(times),
        "cost": _cost(cost(secured, state, features, labels)),
    }, learned


def _cost(found: Cost) -> dict[str, Any] | None:
    if found.ideal:
        return None
    return {
        "rounds": found.rounds,
        "bytes_sent": found.bytes_sent,
        "bytes_dealt": found.bytes_dealt,
        "lan_s": found.seconds(LAN),
        "wan_s": found.seconds(WAN),
    }


def _errors(errors: np.ndarray) -> dict[str, Any]:
    return {
        "largest": float(np.max(np.abs(errors))),
        "rms": float(np.sqrt(np.mean(np.square(errors)))),
        "far": int(np.sum(~(np.abs(errors) <= FAR))),
        "of": errors.size,
    }


if __name__ == "__main__":
    process.answer(lambda order: result_of(Trial.from_json(order)))
