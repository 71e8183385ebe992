"""`ciphernav generate`: draws and renders an Obstacle World data set."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from ciphernav_jax.command_line import SEED, WORKERS, Within
from ciphernav_jax.world import dataset


@dataclass
class Generate:
    """Draw and render environments of Obstacle World. Killed, it resumes to the same bytes.

    For example:

        ciphernav generate --out out/train
        ciphernav generate --split test --count 2250 --out out/test --unseen-by out/train
    """

    out: Path
    """The folder to write; `<out>.partial` is used until it is complete."""
    split: Literal["train", "test", "validation"] = "train"
    """Which of the independent draws."""
    count: Annotated[int, Within(1, dataset.MOST)] = 15_000
    """How many environments; half of them need a detour."""
    seed: Annotated[int, SEED] = 0
    """Decides every environment of a split."""
    workers: Annotated[int, WORKERS] = os.cpu_count() or 1
    """How many rendering processes; the bytes do not depend on it."""
    unseen_by: Path | None = None
    """A data set (the training set, say) with which the new one is to share no pair of layout and
    obstacle cells."""


def render(args: Generate) -> None:
    """Generates the data set and prints what it holds.

    Raises:
        as `dataset.generate` does.
    """
    data = dataset.generate(
        args.split, args.count, args.seed, args.out, workers=args.workers, unseen_by=args.unseen_by
    )
    size = sum(file["bytes"] for file in data.meta["files"].values())
    print(
        f"{args.out}: {len(data):,} environments, {data.detour.sum():,} of them with a detour; "
        f"{len(data.views):,} distinct views, {size / 1e9:.2f} GB."
    )
