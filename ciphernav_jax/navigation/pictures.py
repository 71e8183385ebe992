"""Pictures: training curves, and episodes with the map, the path and the five views."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ciphernav_jax.files import write_png
from ciphernav_jax.navigation.owners import CAMERAS
from ciphernav_jax.navigation.rollout import Episodes, Outcome
from ciphernav_jax.world import topview
from ciphernav_jax.world.dataset import Dataset
from ciphernav_jax.world.grid import START
from ciphernav_jax.world.scenario import Scenario

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


def episodes(dataset: Dataset, driven: Mapping[str, Episodes], chosen: list[int], path: Path) -> None:
    """A row for each chosen environment: from above, each driver's path; then the five views at the start.

    Args:
        dataset: the test environments.
        driven: episodes by the title of who drove.
        chosen: environments.
        path: the PNG to write.
    """
    titles = [*driven, *(f"camera {camera.replace('_', ' ')}" for camera in CAMERAS), "robot's own view"]
    widths = [45 / 60] * len(driven) + [1.0] * (len(titles) - len(driven))
    figure = Figure(figsize=(2.2 * sum(widths), 1.9 * len(chosen) + 0.3), layout="constrained")
    grid = figure.subplots(len(chosen), len(titles), squeeze=False, width_ratios=widths)
    for row, env in zip(grid, chosen, strict=True):
        start = dataset.agent[env, START, dataset.start_heading[env]]
        views = dataset.views[[*dataset.cameras[env], start]]
        paths = [_from_above(dataset, result, env) for result in driven.values()]
        for axes, image in zip(row, [*paths, *views], strict=True):
            axes.imshow(image, interpolation="nearest")
            axes.set(xticks=[], yticks=[])
        for axes, result in zip(row, driven.values(), strict=False):
            axes.set_xlabel(WORDS[Outcome(result.outcome[env])], fontsize=9)
        row[0].set_ylabel("detour required" if dataset.detour[env] else "no detour", fontsize=9)
    for axes, title in zip(grid[0], titles, strict=True):
        axes.set_title(title, fontsize=10)
    _save(figure, path)


def interesting(dataset: Dataset, blind: Episodes, seeing: Episodes) -> list[int]:
    """Environments to show, as far as there are: three that need eyes, one that does not, one that eyes lost.

    The three require a detour, the blind fail there, and they have the longest paths in different layouts.
    """
    won, lost = seeing.outcome == Outcome.SUCCESS, blind.outcome != Outcome.SUCCESS
    detour = np.asarray(dataset.detour)
    chosen = ((won & lost & detour, 3), (won & ~lost & ~detour, 1), (~won, 1))
    return [env for which, count in chosen for env in longest(dataset, seeing, which, count)]


def longest(dataset: Dataset, driven: Episodes, which: NDArray[np.bool_], count: int) -> list[int]:
    """The environments with the longest episodes among `which`, each in another layout."""
    by_length = [env for env in np.argsort(-driven.lengths, kind="stable").tolist() if which[env]]
    layouts = dict.fromkeys(dataset.layout[env] for env in by_length)
    return [next(e for e in by_length if dataset.layout[e] == layout) for layout in layouts][:count]


def from_above(
    scenario: Scenario, cells: Sequence[int], actions: Sequence[int], outcome: Outcome, size: int = 480
) -> NDArray[np.uint8]:
    """An episode from above, uint8[size, size, 3], from the cells it went through and its actions."""
    moves = [action for action in actions if action > 0]
    return topview.draw(
        scenario,
        cells,
        heading=moves[-1] - 1 if moves else None,
        crashed=outcome in (Outcome.CRASH_OBSTACLE, Outcome.CRASH_WALL),
        size=size,
    )


def _from_above(dataset: Dataset, result: Episodes, env: int) -> NDArray[np.uint8]:
    cells, actions = (
        [step for step in of[env].tolist() if step >= 0] for of in (result.cells, result.actions)
    )
    return from_above(dataset.scenario(env), cells, actions, Outcome(result.outcome[env]))


def _save(figure: Figure, path: Path) -> None:
    write_png(path, figure, dpi=110)
