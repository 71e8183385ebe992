"""Pictures: training curves, and episodes with the map, the path and the five views."""

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ciphernav_jax.navigation.parties import CAMERAS
from ciphernav_jax.navigation.rollout import Episodes, Outcome
from ciphernav_jax.world import topview
from ciphernav_jax.world.dataset import Dataset

WORDS = {
    Outcome.SUCCESS: "success",
    Outcome.CRASH_OBSTACLE: "crash: obstacle",
    Outcome.CRASH_WALL: "crash: wall",
    Outcome.NO_CRASH: "lost, no crash",
}


def curves(plain: Mapping[str, list[dict]], classifiers: Mapping[str, list[dict]], path: Path) -> None:
    """Training curves: accuracy and loss end to end, and the losses of the classifiers alone.

    Args:
        plain: by title, points with epoch, loss and accuracy.
        classifiers: by title, points with step and loss.
        path: the PNG to write.
    """
    figure = Figure(figsize=(12, 4), layout="constrained")
    accuracy, loss, alone = figure.subplots(1, 3)
    for title, points in plain.items():
        epochs = [point["epoch"] for point in points]
        accuracy.plot(epochs, [point["accuracy"] for point in points], label=title)
        loss.plot(epochs, [point["loss"] for point in points], label=title)
    for title, points in classifiers.items():
        style = "--" if title.startswith("Plaintext") else "-"
        alone.plot([p["step"] for p in points], [p["loss"] for p in points], style, label=title)
    accuracy.set(title="End to end, in plaintext", xlabel="epoch", ylabel="training accuracy (%)")
    loss.set(title="End to end, in plaintext", xlabel="epoch", ylabel="training loss", yscale="log")
    alone.set(
        title="Classifier alone: the only value opened", xlabel="step", ylabel="squared error", yscale="log"
    )
    for axes in (accuracy, loss, alone):
        axes.grid(alpha=0.3)
        axes.legend(frameon=False)
    _save(figure, path)


def episodes(
    dataset: Dataset, driven: Mapping[str, Episodes], chosen: list[tuple[str, int]], path: Path
) -> None:
    """One row for each chosen episode: the map from above with the path, and the five views at the start.

    Args:
        dataset: the test environments.
        driven: episodes by the title of who drove.
        chosen: pairs of a title and an environment.
        path: the PNG to write.
    """
    titles = ["path taken", *(camera.replace("_", " ") for camera in CAMERAS), "robot, at the start"]
    figure = Figure(figsize=(13, 2.25 * len(chosen) + 0.3), layout="constrained")
    grid = figure.subplots(
        len(chosen), len(titles), squeeze=False, width_ratios=[1.2, *[1.4] * (len(titles) - 1)]
    )
    for row, (driver, env) in zip(grid, chosen, strict=True):
        result = driven[driver]
        scenario = dataset.scenario(env)
        cells = [int(cell) for cell in result.cells[env] if cell >= 0]
        taken = result.actions[env][result.actions[env] > 0]
        outcome = Outcome(result.outcome[env])
        picture = topview.draw(
            scenario,
            cells,
            heading=int(taken[-1]) - 1 if len(taken) else None,
            crashed=outcome in (Outcome.CRASH_OBSTACLE, Outcome.CRASH_WALL),
        )
        start = dataset.agent[env, cells[0], scenario.start_heading]
        views = dataset.views[[*dataset.cameras[env], start]]
        for axes, image in zip(row, [picture, *views], strict=True):
            axes.imshow(image, interpolation="nearest")
            axes.set_xticks([])
            axes.set_yticks([])
        kind = "detour" if dataset.detour[env] else "no detour"
        row[0].set_ylabel(f"{driver}\n{WORDS[outcome]} ({kind})", fontsize=9)
    for axes, title in zip(grid[0], titles, strict=True):
        axes.set_title(title, fontsize=10)
    _save(figure, path)


def interesting(dataset: Dataset, blind: Episodes, seeing: Episodes, count: int) -> list[int]:
    """Environments to show: with a detour, where the blind fail and the seeing succeed, long paths first."""
    won = (blind.outcome != Outcome.SUCCESS) & (seeing.outcome == Outcome.SUCCESS)
    value = seeing.lengths + 100 * (won & np.asarray(dataset.detour))
    return np.argsort(-value, kind="stable")[:count].tolist()


def _save(figure: Figure, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_name(path.name + ".part")
    figure.savefig(aside, format="png", dpi=110)
    os.replace(aside, path)
