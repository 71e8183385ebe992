"""One work, one number of parties, one protocol, measured in a process of its own.

`python -m ciphernav_jax.experiments.measure ORDER.json RESULT.json`; `bench` starts it. A fresh process gives
an honest peak of memory, and compile times in which nothing was prepared.
"""

import resource
import sys
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import jax
import numpy as np

from ciphernav_jax.experiments import floor
from ciphernav_jax.experiments.work import Sizes, error, works
from ciphernav_jax.navigation.storage import read_json, write_json
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.secret import reveal, share

# Calls are repeated until they fill this many seconds, at least 5 times and at most 200.
SECONDS = 3.0

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
        sizes: dict[str, Any] = {
            name: tuple(size) if isinstance(size, list) else size for name, size in order["sizes"].items()
        }
        return Order(**order | {"protocol": protocol, "sizes": Sizes(**sizes)})


def measure(order: Order) -> dict[str, Any]:
    """Trace, compile, warm up, time, and compare with float64.

    Returns:
        trace_s, compile_s; and, unless `compile_only`, seconds (a step's, as of `summary`), peak_bytes (of
        the process, with Python, JAX and the compiler), error (see `work.error`), and needs (see `floor`).
    """
    work = works(order.sizes, order.seed)[order.work]
    keys = jax.random.split(jax.random.key(order.seed), 2)
    args = tuple(
        share(jax.random.fold_in(keys[0], i), arg, parties=order.parties, protocol=order.protocol)
        if secret
        else arg
        for i, (arg, secret) in enumerate(zip(work.args, work.secret, strict=True))
    )
    start = time.perf_counter()
    lowered = jax.jit(work.secured(order.protocol)).lower(keys[1], *args)
    traced = time.perf_counter()
    run = lowered.compile()
    compiled = time.perf_counter()
    result: dict[str, Any] = {"trace_s": traced - start, "compile_s": compiled - traced}
    if order.compile_only:
        return result

    found = jax.block_until_ready(run(keys[1], *args))
    times = []
    while len(times) < (order.repeat or 200):
        key = jax.block_until_ready(jax.random.fold_in(keys[1], len(times)))
        start = time.perf_counter()
        jax.block_until_ready(run(key, *args))
        times.append(time.perf_counter() - start)
        if order.repeat is None and len(times) >= 5 and sum(times) > SECONDS:
            break
    return result | {
        "seconds": summary([t / work.steps for t in times]),
        "peak_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * MAXRSS_UNIT,
        "error": error(reveal(found), work.expected()),
        "needs": floor.needs(work, order.protocol, order.parties, args),
    }


def summary(times: list[float]) -> dict[str, float | int]:
    """Median, quartiles and number of the times."""
    low, median, high = np.percentile(times, [25, 50, 75]).tolist()
    return {"median": median, "q1": low, "q3": high, "repeats": len(times)}


if __name__ == "__main__":
    write_json(Path(sys.argv[2]), measure(Order.from_json(read_json(Path(sys.argv[1])))))
