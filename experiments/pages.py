"""Parts of the documentation that are made from the library itself.

    python -m experiments pages     # docs/api.md and docs/pictures/layouts.png

A test compares both.
"""

import importlib
import inspect
import io
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

import ciphernav_jax
from ciphernav_jax.files import write_bytes, write_text
from ciphernav_jax.world import topview
from ciphernav_jax.world.grid import LAYOUT_PROBABILITIES, LAYOUTS, START, WALLS
from ciphernav_jax.world.poses import centre
from ciphernav_jax.world.scenario import Scenario

DOCS = Path(__file__).parents[1] / "docs"
PACKAGES = ("secret", "comparison", "learning", "ring", "world", "models")
"""Those that have public names of their own."""

HEAD = """# Public names

<!-- made by: python -m experiments pages -->

What may be imported, with the first sentence of its docstring; `help(name)` has the rest. The names in the
first table are `ciphernav_jax`'s own, usually written `cn.share` and so on. The others stand in its packages.
"""


def api() -> str:
    """The page of public names."""
    parts = [HEAD, _section("ciphernav_jax", ciphernav_jax, set())]
    own = set(ciphernav_jax.__all__)
    for name in PACKAGES:
        package = importlib.import_module(f"ciphernav_jax.{name}")
        parts.append(_section(f"ciphernav_jax.{name}", package, own))
    return "\n".join(parts)


def _section(title: str, package: ModuleType, but: set[str]) -> str:
    rows = [f"| `{name}` | {_said(getattr(package, name))} |" for name in package.__all__ if name not in but]
    return "\n".join([f"## {title}", "", "| name | what it is |", "| --- | --- |", *rows, ""])


def _said(thing: Any) -> str:
    """The first sentence of a docstring; of a constant its value."""
    if not (inspect.ismodule(thing) or callable(thing)):
        return f"`{thing!r}`"
    text = " ".join((inspect.getdoc(thing) or "").split("\n\n")[0].split())
    return re.match(r".*?[.:;](?= [A-Z`]|$)|.*", text)[0].rstrip(".:;")  # pyright: ignore[reportOptionalSubscript]


def layouts(columns: int = 4, size: int = 230) -> Image.Image:
    """The layouts from above, with their numbers and probabilities, and the numbers of the free cells."""
    margin, line = 10, 20
    rows = -(-len(LAYOUTS) // columns)
    page = Image.new(
        "RGB", (columns * (size + margin) + margin, rows * (size + line + margin) + margin), "white"
    )
    pen, font, small = ImageDraw.Draw(page), ImageFont.load_default(15), ImageFont.load_default(12)
    for number in range(len(LAYOUTS)):
        row, column = divmod(number, columns)
        left, top = margin + column * (size + margin), margin + row * (size + line + margin)
        pen.text((left, top), f"layout {number}, {LAYOUT_PROBABILITIES[number]:.0%}", "black", font)
        # A wall cannot be the goal: none is drawn.
        wall = int(np.flatnonzero(WALLS[number])[0])
        world = Scenario(number, start_heading=3, goal=wall, obstacles=())
        page.paste(Image.fromarray(topview.draw(world, (START,), size=size)), (left, top + line))
        for cell in np.flatnonzero(~WALLS[number]).tolist():
            if cell != START:  # where the robot stands
                x, z = topview.pixel(centre(cell), size).tolist()
                pen.text((left + x, top + line + z), str(cell), "black", small, anchor="mm")
    return page


def write() -> None:
    """Write both."""
    write_text(DOCS / "api.md", api())
    file = io.BytesIO()
    layouts().quantize(64).save(file, "png", optimize=True)
    write_bytes(DOCS / "pictures" / "layouts.png", file.getvalue())
