"""What each command can be told; the texts are what `--help` shows."""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, get_args

import tyro

from ciphernav_jax.command_line import COUNT, PARTIES, SECONDS, SEED, WORKERS, Within

Method = Literal[
    "map-only", "first-person", "first-person-deterministic", "plaintext", "plaintext-classifier", "secret"
]
WorkName = Literal["product", "relu", "forward-public", "forward", "train", "train-loop"]

# What `sweep` compares unless told otherwise. The ripple adder is left to ask for: 63 rounds.
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
    Robots then drive by it too. See `ciphernav sweep --help`."""
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
class Bench:
    """Time secret-shared work beside what the machine can do and, with `--peers`, beside other frameworks.

    Each work with each number of parties runs in a process of its own: tracing, cold compilation, then
    calls until three seconds are full. The table gives their median, the least time that the products and
    the random numbers need on this machine (the floor), compile times, peak memory, and the error against
    float64.

    `--peers` makes a virtual environment for each of CrypTen, SPU and PriX (several GB, from the package
    index that pip is set up for) and runs the same work there. Finished measurements of peers are kept:
    the same command goes on where it was. A peer that cannot be installed or does not finish is said so.

    For example:

        ciphernav bench --work train --parties 2 5 --variant default truncation=nearest
        ciphernav bench --peers
    """

    out: Path = Path("out/bench")
    """Folder for bench.json and bench.md, and for the peers."""
    parties: PartiesList = field(default_factory=lambda: [2, 3, 5, 8, 16])
    """Numbers of parties; of them a peer runs those that it can do, at most 5."""
    work: Annotated[list[WorkName], tyro.conf.arg(metavar="WORK [WORK ...]")] = field(
        default_factory=lambda: list(get_args(WorkName))
    )
    """What to time: product, relu, forward, forward-public (public weights), train (one step), train-loop
    (steps in one compiled loop). All of them by default."""
    variant: VariantList = field(default_factory=lambda: ["default"])
    """Protocols, each as what differs from the default, such as truncation=nearest,frac_bits=16. The peers
    are compared with the first."""
    repeat: Annotated[int | None, COUNT] = None
    """Timed calls; by default as many as fit in three seconds, and 5 of a peer."""
    seed: Annotated[int, SEED] = 0
    """Of the inputs, the shares and the protocols."""
    peers: bool = False
    """Run the other frameworks too."""
    time_limit: Annotated[float, SECONDS] = 300
    """Seconds after which a peer's work counts as not finished."""


@dataclass
class Sweep:
    """Compare protocol variants and numbers of parties, on one table and one picture.

    For each: seconds of a training step and of a forward pass of the paper's classifier; rounds, bytes, and
    the time they take on a LAN and a WAN; errors of outputs, gradients and of the loss after a training,
    against float64; and how often truncations fail. A variant is written as what differs from the default:
    NAME=VALUE, several with commas. The names are multiplication, truncation, comparison, adder,
    range_bits, frac_bits and generator; a wrong value is answered with those there are.

    Each variant with each number of parties runs in a process of its own, and what OUT holds already is kept:
    the same command goes on where it was killed, and another one adds to the same table.

    For example:

        ciphernav sweep --parties 2 5 --variant default truncation=nearest,frac_bits=16
        ciphernav sweep --out out/quick --parties 2 --steps 10
    """

    out: Path = Path("out/sweep")
    """Folder for sweep.json, sweep.md and sweep.png."""
    parties: PartiesList = field(default_factory=lambda: [2, 5])
    """Numbers of parties. A variant takes longer with more of them, resharing by far the most."""
    variant: VariantList = field(default_factory=lambda: list(VARIANTS))
    """Protocols, each as what differs from the default. *Ideal* variants, a trusted third party, are no
    protocols and are marked so; local truncation is for two parties."""
    steps: Annotated[int, COUNT] = 100
    """Steps of the training whose loss is compared with float64; a multiple of 10."""
    time_limit: Annotated[float, SECONDS] = 15
    """Seconds: no such training where it would take longer; its steps are then timed alone."""
    seed: Annotated[int, SEED] = 0
    """Of the weights, the data, the shares and the protocols."""


@dataclass
class Report:
    """Set all results beside the paper's, on one page and as tables.

    OUT then holds the page (report.html, one file that loads nothing from elsewhere), the tables in Markdown
    (paper.md), and the pictures. What has no result file is said to be missing, with the command that
    makes it.

    For example:

        ciphernav report
        ciphernav report --results results --out out/report --readme README.md
    """

    results: Path = Path("results")
    """Folder with paper/*.json, bench.json and sweep.json, as far as they are there."""
    out: Path = Path("out/report")
    """Folder for the report."""
    readme: Path | None = None
    """A Markdown file whose blocks `<!-- report: NAME -->` to `<!-- end -->` are filled with the tables of
    these names, and whose pictures in RESULTS/paper are replaced."""
