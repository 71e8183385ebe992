"""Episodes from what `experiments.paper.episodes` wrote: from above, and what each party saw of one."""

import base64
import io
import textwrap
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ciphernav_jax.files import write_bytes, write_png
from ciphernav_jax.navigation.owners import SLOTS, Party, cast
from ciphernav_jax.navigation.pictures import WORDS, from_above
from ciphernav_jax.navigation.rollout import Outcome
from ciphernav_jax.world import topview
from ciphernav_jax.world.grid import ACTIONS
from ciphernav_jax.world.poses import IMAGE_SHAPE
from ciphernav_jax.world.scenario import Obstacle, Scenario
from experiments.report.figures import DPI
from experiments.report.results import Document

Pixels = NDArray[np.uint8]
HEIGHT, WIDTH = IMAGE_SHAPE[:2]
HEADINGS = {slot: slot.replace("_", " ") for slot in SLOTS} | {"agent": "robot's view", "map": "map"}


class Frame(NamedTuple):
    """One step of an episode.

    Attributes:
        truth: the world from above, which no party sees whole.
        tiles: by party and slot, what the party holds of it: the slot itself if it is its own, else a share.
        caption: what happens.
    """

    truth: Pixels
    tiles: dict[tuple[int, str], Pixels]
    caption: str


def drawn(episode: Document, size: int = 240) -> Pixels:
    """An episode from above."""
    return from_above(
        _scenario(episode), episode["cells"], episode["actions"], Outcome[episode["outcome"].upper()], size
    )


def caption(episode: Document) -> str:
    """How it ended, and how long it took."""
    taken, shortest = len(episode["actions"]), episode["shortest"]
    words = [WORDS[Outcome[episode["outcome"].upper()]], f"{taken} actions"]
    if taken != shortest:
        words.append(f"the shortest path takes {shortest}")
    return ", ".join(words) + ("; detour required" if episode["detour"] else "")


def frames(watched: Document, parties: int) -> Iterator[Frame]:
    """An episode step by step."""
    scenario, cells, actions = _scenario(watched), watched["cells"], watched["actions"]
    for step, (told, action) in enumerate(zip(watched["steps"], actions, strict=True)):
        path = cells[: step + 1]
        heading = actions[step - 1] - 1 if step else scenario.start_heading
        own = {camera: unpacked(view) for camera, view in watched["views"].items()}
        own["agent"] = unpacked(told["view"])
        # The robot's map: walls, goal and itself, but no obstacle.
        own["map"] = topview.draw(
            replace(scenario, obstacles=()), path[-1:], heading=heading, size=2 * HEIGHT
        )
        shares = {slot: noise(text, parties) for slot, text in (watched["shares"] | told["shares"]).items()}
        yield Frame(
            topview.draw(scenario, path, heading=heading, size=320),
            {
                (number, slot): own[slot] if slot in party.slots else shares[slot][number]
                for number, party in enumerate(cast(parties))
                for slot in SLOTS
            },
            f"Step {step + 1} of {len(actions)}. The one value opened: {ACTIONS[action]}.",
        )


def noise(text: str, parties: int) -> Pixels:
    """Every party's share as a grey picture, uint8[P, h, 2h]: the highest byte of each word."""
    values = np.frombuffer(base64.b64decode(text), np.uint8).reshape(parties, -1)
    return values.reshape(parties, round((values.shape[1] / 2) ** 0.5), -1)


def unpacked(png: str) -> Pixels:
    """The pixels of a PNG in base64."""
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(png))))


def uri(image: Pixels) -> str:
    """The image as it stands in a page."""
    file = io.BytesIO()
    # Few colours are enough from above, and take a third of the bytes.
    picture = Image.fromarray(image)
    if image.ndim == 3:
        picture = picture.quantize(128)
    picture.save(file, format="png", optimize=True)
    return "data:image/png;base64," + base64.b64encode(file.getvalue()).decode()


def sheet(document: Document, path: Path, columns: int = 5) -> None:
    """Write a PNG of all chosen episodes, those of a kind together."""
    episodes = [episode for chosen in document["episodes"].values() for episode in chosen]
    rows = -(-len(episodes) // columns)
    figure = Figure(figsize=(2.2 * columns, 2.75 * rows), layout="constrained")
    for axes in figure.subplots(rows, columns, squeeze=False).flat:
        axes.set_axis_off()
    for axes, episode in zip(figure.axes, episodes, strict=False):
        axes.imshow(drawn(episode))
        axes.set_title(textwrap.fill(caption(episode), 30), fontsize=8)
    write_png(path, figure, dpi=DPI)


def parties(frame: Frame, count: int, path: Path) -> None:
    """Write a PNG of one step: the world from above, and what each party holds; its own is framed."""
    rows = cast(count)
    figure = Figure(figsize=(11.5, 0.85 * len(rows) + 0.35), layout="constrained")
    left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=(1, 1.75)).flat
    above = left.subplots()
    above.imshow(frame.truth)
    above.set_axis_off()
    above.set_title(frame.caption, fontsize=9)
    for number, (row, party) in enumerate(
        zip(right.subplots(len(rows), len(SLOTS), squeeze=False), rows, strict=True)
    ):
        for axes, slot in zip(row, SLOTS, strict=True):
            own = slot in party.slots
            tile = frame.tiles[number, slot]
            aspect = "equal" if tile.ndim == 3 else "auto"
            axes.imshow(tile, cmap="gray", vmin=0, vmax=255, interpolation="nearest", aspect=aspect)
            axes.set_box_aspect(HEIGHT / WIDTH)
            axes.set(xticks=[], yticks=[])
            axes.spines[:].set(visible=own, color="#D55E00", linewidth=2.5)
            if not number:
                axes.set_title(HEADINGS[slot], fontsize=9)
        row[0].set_ylabel(name(party).replace("Camera ", "Camera\n"), fontsize=8)
    write_png(path, figure, dpi=DPI)


def animation(shown: list[Frame], parties: int, path: Path) -> None:
    """Write an animated GIF of `frames`."""
    left, margin, line = 330, 4, 18
    height = max(len(shown[0].truth) + 2 * line, len(cast(parties)) * (HEIGHT + line + margin))
    font = ImageFont.load_default(12)
    pages = []
    for frame in shown:
        page = Image.new("RGB", (left + len(SLOTS) * (WIDTH + margin), height), "white")
        pen = ImageDraw.Draw(page)
        page.paste(Image.fromarray(frame.truth), (0, 0))
        pen.text((margin, len(frame.truth) + margin), frame.caption, "black", font)
        for number, party in enumerate(cast(parties)):
            top = number * (HEIGHT + line + margin)
            pen.text((left, top), name(party), "black", font)
            for column, slot in enumerate(SLOTS):
                tile = Image.fromarray(frame.tiles[number, slot]).convert("RGB")
                size = (HEIGHT, HEIGHT) if slot == "map" else (WIDTH, HEIGHT)
                page.paste(
                    tile.resize(size, Image.Resampling.NEAREST),
                    (left + column * (WIDTH + margin), top + line),
                )
        pages.append(page.quantize(64))
    durations = [900] * (len(pages) - 1) + [3000]
    file = io.BytesIO()
    pages[0].save(file, "gif", save_all=True, append_images=pages[1:], duration=durations, loop=0)
    write_bytes(path, file.getvalue())


def _scenario(episode: Document) -> Scenario:
    told = episode["scenario"]
    return Scenario(**(told | {"obstacles": tuple(Obstacle(**obstacle) for obstacle in told["obstacles"])}))


def name(party: Party) -> str:
    """In few words."""
    return party.name.replace("owner of camera", "camera").replace("_", " ").capitalize()
