"""Two parties hold columns of one table, train on all of them, keep a file each, and go on from the files.

python examples/vertical_split.py --out out/vertical
"""

import argparse
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import ciphernav_jax as cn


def train(w, a, b, y, steps):
    """Gradient descent on the squared loss of a linear score."""
    x = jnp.concatenate([a, b], axis=1)

    def body(w, _):
        return w - (0.2 / len(y)) * (x.T @ (x @ w - y)), None

    return jax.lax.scan(body, w, length=steps)[0]


def save(folder, secret):
    """Each party writes its own row, and nothing else."""
    folder.mkdir(parents=True, exist_ok=True)
    for party, row in enumerate(secret.shares):
        np.save(folder / f"party-{party}.npy", row)


def load(folder, parties):
    """The rows together again; what they do not say is public."""
    rows = [np.load(folder / f"party-{party}.npy") for party in range(parties)]
    return cn.Secret(jnp.stack(rows), frac_bits=20, dtype=np.dtype("float64"), rank=1)


def main(rows=300, steps=20, out=Path("out/vertical")):
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(rows, 4))
    y = np.sign(columns @ [1.0, -1.0, 1.0, 1.0] + 0.3 * rng.normal(size=rows))
    key = iter(jax.random.split(jax.random.key(0), 5))
    a = cn.share(next(key), columns[:, :2], parties=2)  # the first party's
    b, labels = cn.share(next(key), (columns[:, 2:], y), parties=2)  # the second one's
    step = cn.secure(lambda w, a, b, y: train(w, a, b, y, steps))
    w = step(next(key), cn.share(next(key), np.zeros(4), parties=2), a, b, labels)
    save(out, w)
    w = step(next(key), load(out, 2), a, b, labels)  # goes on where the files end
    right = np.mean(np.sign(columns @ cn.reveal(w)) == y)
    print(f"right after {2 * steps} steps: {100 * right:.0f} %")
    return right


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--out", type=Path, default=Path("out/vertical"))
    main(**vars(options.parse_args()))
