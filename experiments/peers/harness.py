"""What the workers share. They run in the peers' own environments and import nothing of ciphernav_jax."""

import sys
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np


class Job(NamedTuple):
    """What a worker is asked for: `worker.py INPUTS.npz RESULT.npz PARTIES REPEATS [MORE]`."""

    work: str
    rate: float
    weights: list
    data: list
    result: str
    parties: int
    repeats: int
    more: list


def job() -> Job:
    """The job on the command line; arrays are float32."""
    inputs, result, parties, repeats, *more = sys.argv[1:]
    with np.load(inputs) as stored:
        kernels = sorted(name for name in stored if name.startswith("kernel"))
        weights = [(stored[name], stored[name.replace("kernel", "bias")]) for name in kernels]
        data = [stored[name] for name in ("x", "y") if name in stored]
        return Job(
            str(stored["work"]),
            float(stored["rate"]),
            weights,
            data,
            result,
            int(parties),
            int(repeats),
            more,
        )


def timed(step: Callable[[], Any], barrier: Callable[[], Any], repeats: int) -> tuple[list[float], Any]:
    """Seconds of each call but the first, until all parties are done, and the last result."""
    seconds = []
    result = step()
    for _ in range(repeats):
        barrier()
        start = time.perf_counter()
        result = step()
        barrier()
        seconds.append(time.perf_counter() - start)
    return seconds, result


def save(path: str, seconds: list, outputs: list) -> None:
    """The seconds of each call, and the outputs of one in the order of JAX's pytrees."""
    named: dict = {f"output{i}": np.asarray(output, np.float64) for i, output in enumerate(outputs)}
    np.savez(path, seconds=np.asarray(seconds), **named)


def by_hand(job: Job, weights: list, x: Any, y: Any, *, transpose: Callable, column_sum: Callable):
    """The training step without autograd, on arrays that know `@`, `relu`, `square`, `>`, `+`, `-` and `*`.

    As the loss is a sum, gradients stay far above the 2^-16 that such arrays resolve.

    Returns:
        The new weights, and the loss.
    """
    inputs, signs = [x], []
    for kernel, bias in weights[:-1]:
        z = inputs[-1] @ kernel + bias
        signs.append(z > 0)
        inputs.append(z * signs[-1])
    kernel, bias = weights[-1]
    off = inputs[-1] @ kernel + bias - y
    loss = off.square().sum()
    slope = off * 2
    updated = []
    for i in reversed(range(len(weights))):
        kernel, bias = weights[i]
        gradient = transpose(inputs[i]) @ slope, column_sum(slope)
        updated.append((kernel - gradient[0] * job.rate, bias - gradient[1] * job.rate))
        if i:
            slope = (slope @ transpose(kernel)) * signs[i - 1]
    return updated[::-1], loss
