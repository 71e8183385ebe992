"""What each command can be told; the texts are what `--help` shows."""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from ciphernav_jax.command_line import COUNT, PARTIES, SEED, WORKERS, Within

Method = Literal[
    "map-only", "first-person", "first-person-deterministic", "plaintext", "plaintext-classifier", "secret"
]

EPOCHS = Within(1, 10_000)

PartiesList = Annotated[list[int], PARTIES, tyro.conf.arg(metavar="P [P ...]")]
VariantList = Annotated[list[str], tyro.conf.arg(metavar="VARIANT [VARIANT ...]")]


@dataclass
class Train:
    """Train a navigator. Killed, the same command goes on with it and ends with the same bits.

    `map-only`, `first-person`, `first-person-deterministic` and `plaintext` (camera views) train
    encoders and classifier together in plaintext. `secret` keeps a plaintext training's encoders and
    trains a new classifier from scratch under secret sharing; `plaintext-classifier` does the same
    without secrets, for comparison.

    For example:

        ciphernav train --method plaintext --data out/train --out out/plaintext
        ciphernav train --method secret --parties 5 --encoders out/plaintext --data out/train --out out/secret
    """

    method: Method
    """What the robot sees, and whether in secret."""
    data: Path
    """Training set, made by `ciphernav generate --split train`."""
    out: Path
    """Folder for the checkpoints, the result and the training curve."""
    parties: Annotated[int | None, PARTIES] = None
    """Parties of a secret training: 2 (robot, owner of all cameras), 5 (robot, four owners), or any
    other number from 2 on. Default 2."""
    variant: str = "default"
    """Protocol of a secret training, as what differs from the default: truncation=nearest,opened=logits.
    Robots then drive by it too. The names are those of `ciphernav_jax.Protocol`."""
    encoders: Path | None = None
    """Finished `plaintext` training whose encoders to keep; without it one is trained in OUT/encoders."""
    seed: Annotated[int, SEED] = 0
    """Decides everything random."""
    epochs: Annotated[int | None, EPOCHS] = None
    """Passes over the environments when training end to end; default 24."""
    steps: Annotated[int | None, COUNT] = None
    """Steps of a secret training, or of plaintext-classifier; default 1060."""
    batch: Annotated[int | None, COUNT] = None
    """Batch size: environments end to end (default 50), samples for a classifier alone (default 500)."""
    loss: Literal["cross-entropy", "squared"] = "cross-entropy"
    """Loss end to end; the paper's is squared. A classifier alone always has the squared loss."""


@dataclass
class Evaluate:
    """Let a trained navigator drive in every environment of a test set, and count how it ends.

    A secret one drives under secret sharing: the best action is opened at each step, nothing else. With
    `--parties` so does one that was trained in plaintext: its weights are then public, the inputs secret.

    For example:

        ciphernav evaluate --model out/secret --data out/test
        ciphernav evaluate --model random --data out/test
    """

    model: Path
    """Folder of a finished `ciphernav train`; `random` for the random walk."""
    data: Path
    """Test set, made by `ciphernav generate --split test`."""
    out: Path | None = None
    """Folder for metrics.json; by default MODEL/evaluation (out/random for the random walk)."""
    parties: Annotated[int | None, PARTIES] = None
    """Drive under secret sharing among so many parties; for a secret training the number it was trained with.
    """
    variant: str = "default"
    """Protocol with `--parties`, as what differs from the default: opened=logits. A secret training drives by
    the one that it was trained with."""
    seed: Annotated[int, SEED] = 0
    """Of the shares and protocols, or of the random walk."""


@dataclass
class Demo:
    """The whole job, small: make a world, train in plaintext and in secret, navigate, print the table.

    Takes a few minutes on two cores. OUT then holds the table (table.json, table.md), the
    training curves (curves.png) and some episodes (episodes.png). Killed, it goes on where it was.

    For example:

        ciphernav demo --out out/demo
        ciphernav demo --out out/tiny --train 200 --test 50 --epochs 2 --steps 20 --parties 3
    """

    out: Path = Path("out/demo")
    """Folder for everything that is made."""
    seed: Annotated[int, SEED] = 0
    """Decides everything random."""
    train: Annotated[int, COUNT] = 3000
    """Training environments."""
    test: Annotated[int, COUNT] = 600
    """Test environments."""
    epochs: Annotated[int, EPOCHS] = 18
    """Epochs of the plaintext trainings."""
    steps: Annotated[int, COUNT] = 424
    """Steps of the secret trainings."""
    parties: PartiesList = field(default_factory=lambda: [2, 5])
    """Numbers of parties to train with in secret."""
    workers: Annotated[int, WORKERS] = os.cpu_count() or 1
    """Rendering processes."""


@dataclass
class Sweep:
    """Compare protocol variants and numbers of parties on a function of your own.

    For each: seconds of a call, seconds of compiling, rounds, bytes, the time they take on a LAN and a WAN,
    the largest error of a value and of the gradient against float64, truncations that failed, and memory. A
    variant is written as what differs from the default: NAME=VALUE, several with commas. The names are those
    of `ciphernav_jax.Protocol`; a wrong value is answered with those there are.

    FUNCTION is written package.module:name. It is called without arguments and returns what to compare and
    its arguments, (function, *args): all of these are shared, what the function closes over is public. It is
    looked for in this folder and among what is installed. Without it, it is a training step of the paper's
    classifier, batch 500, with weights, features and labels secret.

    What OUT holds already is kept: the same command goes on where it was killed, and further variants and
    parties add to the same table. `ciphernav_jax.compare` does the same in Python.

    For example:

        ciphernav sweep --parties 2 3 --variant default truncation=nearest
        ciphernav sweep --function package.module:name --variant default comparison=resharing --out out/mine
    """

    function: str | None = None
    """What to compare on, package.module:name."""
    out: Path = Path("out/sweep")
    """Folder for comparison.json, comparison.md and comparison.png."""
    parties: PartiesList = field(default_factory=lambda: [2, 3, 5])
    """Numbers of parties."""
    variant: VariantList = field(
        default_factory=lambda: [
            "default",
            "truncation=nearest",
            "comparison=resharing",
            "multiplication=ideal,truncation=ideal,comparison=ideal",
        ]
    )
    """Protocols, each as what differs from the default. *Ideal* variants, a trusted third party, are no
    protocols and are marked so."""
    repeat: Annotated[int | None, COUNT] = None
    """Timed calls; by default as many as fit in a second, at least 3."""
    seed: Annotated[int, SEED] = 0
    """Of the shares and the protocols, and of the paper's classifier and its data."""
