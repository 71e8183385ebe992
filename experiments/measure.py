"""One work, one number of parties, one protocol, measured in a process of its own.

`python -m experiments.measure ORDER.json RESULT.json`; `bench` starts it. A fresh process gives
an honest peak of memory, and compile times in which nothing was prepared.
"""

import resource
import sys
from dataclasses import asdict, dataclass, field
from typing import Any

import jax
import numpy as np
from jax import Array

from ciphernav_jax.comparison.timing import calls, compiled
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.ring import keys
from ciphernav_jax.secret import reveal, share
from experiments import floor, process
from experiments.work import Sizes, Work, error, works

# Calls are repeated until they fill so many seconds, at least so often.
SECONDS = 3.0
FEWEST = 5

MAXRSS_UNIT = 1 if sys.platform == "darwin" else 1024


@dataclass(frozen=True)
class Order:
    """What to measure."""

    work: str
    parties: int
    protocol: Protocol = field(default_factory=Protocol)
    sizes: Sizes = field(default_factory=Sizes)
    seed: int = 0
    repeat: int | None = None
    """Timed calls; None for as many as fit in `SECONDS`."""
    compile_only: bool = False
    """Only trace and compile, to see what a filled compilation cache saves."""

    def as_json(self) -> dict:
        return asdict(self)

    @staticmethod
    def from_json(order: dict) -> "Order":
        protocol = Protocol(**order["protocol"])
        return Order(**order | {"protocol": protocol, "sizes": Sizes.from_json(order["sizes"])})


def measure(order: Order) -> dict[str, Any]:
    """Trace, compile, warm up, time, and compare with float64.

    Returns:
        trace_s, compile_s; and, unless `compile_only`, seconds (a step's, as of `summary`), peak_bytes (of
        the process, with Python, JAX and the compiler), error (see `work.error`), and needs (see `floor`).
    """
    work = works(order.sizes, order.seed)[order.work]
    key = keys.derive(
        keys.root(order.seed), "measure", order.work, repr(order.sizes), str(order.protocol), order.parties
    )
    call_key = keys.derive(key, "call")
    args = shared(work, key, order.parties, order.protocol)
    run, result = compiled(work.secured(order.protocol), call_key, *args)
    if order.compile_only:
        return result

    found = jax.block_until_ready(run(call_key, *args))
    timed = calls(run, call_key, args, order.repeat, seconds=SECONDS, fewest=FEWEST)
    times = [seconds for seconds, _ in timed]
    return result | {
        "seconds": summary([t / work.steps for t in times]),
        "peak_bytes": peak_bytes(),
        "error": error(reveal(found), work.expected()),
        "needs": floor.needs(work, order.protocol, order.parties, args),
    }


def shared(work: Work, key: Array, parties: int, protocol: Protocol) -> tuple[Any, ...]:
    """The arguments of a work, those that are secret as shares of so many parties."""
    return tuple(
        share(keys.derive(key, "argument", i), arg, parties=parties, protocol=protocol) if secret else arg
        for i, (arg, secret) in enumerate(zip(work.args, work.secret, strict=True))
    )


def peak_bytes() -> int:
    """Peak memory of this process, with Python, JAX and the compiler."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * MAXRSS_UNIT


def summary(times: list[float]) -> dict[str, float | int]:
    """Median, quartiles and number of the times."""
    low, median, high = np.percentile(times, [25, 50, 75]).tolist()
    return {"median": median, "q1": low, "q3": high, "repeats": len(times)}


if __name__ == "__main__":
    process.answer(lambda order: measure(Order.from_json(order)))
