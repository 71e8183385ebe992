"""What each experiment can be told; the texts are what `--help` shows."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, get_args

import tyro

from ciphernav_jax.cli.options import PartiesList, VariantList
from ciphernav_jax.command_line import COUNT, SECONDS, SEED

WorkName = Literal["product", "relu", "forward-public", "forward", "train", "train-loop"]


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

        python -m experiments bench --work train --parties 2 5 --variant default truncation=nearest
        python -m experiments bench --peers
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
class Report:
    """Set all results beside the paper's, on one page and as tables.

    OUT then holds the page (report.html, one file that loads nothing from elsewhere), the tables in Markdown
    (paper.md), and the pictures. What has no result file is said to be missing, with the command that
    makes it.

    For example:

        python -m experiments report
        python -m experiments report --results experiments/results --readme docs/results/paper.md
    """

    results: Path = Path("experiments/results")
    """Folder with paper/*.json and bench.json, as far as they are there."""
    out: Path = Path("out/report")
    """Folder for the report."""
    readme: Path | None = None
    """A Markdown file whose blocks `<!-- report: NAME -->` to `<!-- end -->` are filled with the tables of
    these names, and whose pictures are replaced: README.md, docs/results/paper.md and variants.md."""


@dataclass
class Primitives:
    """Print the table of all primitives that `secure` takes, with what each costs: docs/primitives.md.

    For example:

        python -m experiments primitives > docs/primitives.md
    """


@dataclass
class Pages:
    """Make the parts of the documentation anew that come from the library: docs/api.md, and a picture.

    For example:

        python -m experiments pages
    """


@dataclass
class Programs:
    """Compile many functions on secrets with their gradients in one process: it must live.

    For example:

        python -m experiments programs --count 500
    """

    count: Annotated[int, COUNT] = 500
    """Functions, each compiled, and called again at the end."""
