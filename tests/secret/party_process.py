"""One operating-system process of the deployment test: runs a secret training step and saves its shares.

python -m tests.secret.party_process OUT devices
    both parties in this process, on two forced CPU devices
python -m tests.secret.party_process OUT process RANK PORT
    party RANK of two, joined by jax.distributed on loopback
"""

import os
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import ciphernav_jax as cn

from ..patience import PATIENCE_S
from .training import training_step

PARTIES = 2


def loops(x, n):
    """A scan, a branch and a loop that only the run decides on; n is public."""
    scanned = jax.lax.scan(lambda carry, row: (carry * row, jax.nn.relu(row)), x[0], x)
    branched = jax.lax.cond(n > 1, lambda: x * x, lambda: x)
    return scanned, branched, jax.lax.fori_loop(0, n, lambda i, carry: carry * x[i], x[0])


def everything(weights, x, y, n):
    return training_step(weights, x, y), loops(x[:3], n)


def inputs():
    """The shares that the parties start from, and a public number; the same in every process."""
    keys = jax.random.split(jax.random.key(7), 4)
    shapes = {"first": (6, 5), "second": (5, 3)}
    weights = {
        name: jax.random.normal(k, shape, jnp.float32)
        for k, (name, shape) in zip(keys, shapes.items(), strict=False)
    }
    x = jax.random.normal(keys[2], (9, 6), jnp.float32)
    y = jax.random.normal(keys[3], (9, 3), jnp.float32)
    return *cn.share(jax.random.key(8), (weights, x, y), parties=PARTIES), np.int64(2)


def shares_of(result) -> list[np.ndarray]:
    """All shares of a result, those of the parties in this process, party by party."""
    return [
        np.concatenate(
            [shard.data for shard in sorted(x.shares.addressable_shards, key=lambda s: s.index[0].start or 0)]
        )
        for x in jax.tree.leaves(result, is_leaf=lambda x: isinstance(x, cn.Secret))
    ]


def main() -> None:
    out, mode = Path(sys.argv[1]), sys.argv[2]
    if mode == "process":
        rank, port = int(sys.argv[3]), sys.argv[4]
        jax.config.update("jax_cpu_collectives_implementation", "gloo")
        jax.distributed.initialize(
            f"127.0.0.1:{port}",
            PARTIES,
            rank,
            initialization_timeout=PATIENCE_S,
            heartbeat_timeout_seconds=PATIENCE_S,
            shutdown_timeout_seconds=PATIENCE_S,
        )
        assert jax.process_count() == PARTIES
        assert jax.local_device_count() == 1
        name = f"process{rank}"
    else:
        name = "devices"
    mesh = jax.make_mesh((PARTIES,), ("party",))
    # numpy inputs: every process holds the same, and each device takes its party's part.
    args = jax.tree.map(np.asarray, inputs())
    result = cn.deploy(cn.secure(everything), mesh)(jax.random.key(9), *args)
    np.savez(out / f"{name}.npz", *shares_of(result))


if __name__ == "__main__":
    if sys.argv[2] == "devices":
        flags = os.environ.get("XLA_FLAGS", "")
        os.environ["XLA_FLAGS"] = f"{flags} --xla_force_host_platform_device_count={PARTIES}"
    main()
