"""Variants of the protocols compared on a function of one's own: what a call costs, and how far off it is.

python examples/variants.py --parties 3
"""

import argparse

import jax
import jax.numpy as jnp
import numpy as np

import ciphernav_jax as cn

VARIANTS = ("default", "truncation=nearest", "truncation=wrap-count", "frac_bits=16", "comparison=resharing")


def function(x, w):
    """Put your own here."""
    return jax.nn.relu(x @ w).max(axis=1)


def compared(variant, parties, args, seed=0):
    """Rounds, bytes sent, seconds on a WAN, and the largest error."""
    protocol = cn.Protocol.parse(variant)
    sharing, calling = jax.random.split(jax.random.key(seed))
    secrets = cn.share(sharing, args, parties=parties, protocol=protocol)
    step = cn.secure(function, protocol=protocol)
    cost = cn.cost(step, *secrets)
    error = jnp.abs(cn.reveal(step(calling, *secrets)) - function(*args)).max()
    return cost.rounds, cost.bytes_sent, cost.seconds(cn.WAN), float(error)


def main(parties=3, rows=100, variants=VARIANTS):
    rng = np.random.default_rng(0)
    args = jnp.asarray(rng.normal(size=(rows, 20))), jnp.asarray(rng.normal(size=(20, 5)))
    print(f"{'variant':24}{'rounds':>8}{'MB sent':>9}{'WAN s':>8}{'error':>10}")
    found = {}
    for seed, variant in enumerate(variants):  # a key of its own for each
        found[variant] = rounds, sent, seconds, error = compared(variant, parties, args, seed)
        print(f"{variant:24}{rounds:8}{sent / 1e6:9.2f}{seconds:8.2f}{error:10.1e}")
    return found


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--parties", type=int, default=3)
    main(**vars(options.parse_args()))
