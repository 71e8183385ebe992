"""Obstacle World: its environment, renderer and data set; no secrets here.

In import order; MiniWorld and OpenGL are touched only from `renderer` on, JAX nowhere.

- `grid`: layouts, moves, the map that the model reads.
- `planner`: shortest paths, the detour test, labels.
- `poses`: where the cameras stand.
- `scenario`: what one environment consists of, and how it is drawn.
- `visibility`: which obstacles a view may contain.
- `gl`: OpenGL, or a message that says what is missing.
- `renderer`: views, drawn by MiniWorld.
- `probe`: whether OpenGL works.
- `topview`: a picture of the map, the obstacles, the cameras and a path.
- `window`: shows pictures, for `render_mode="human"`.
- `environment`: `ObstacleWorld`, the gymnasium environment.
- `shards`, `journal`: rendering in processes, and writing so that a killed run resumes.
- `dataset`: the data set on disk; `load` and `generate`.
- `generate`: the command line.
"""

from ciphernav_jax import extras

extras.require("navigation", "Obstacle World")

import gymnasium  # noqa: E402

from ciphernav_jax.world.dataset import Dataset, load  # noqa: E402

ENVIRONMENT_ID = "ciphernav_jax/ObstacleWorld-v0"

__all__ = ["ENVIRONMENT_ID", "Dataset", "load", "register"]


def register() -> None:
    """Makes `gymnasium.make("ciphernav_jax/ObstacleWorld-v0")` work; importing this package calls it."""
    if ENVIRONMENT_ID not in gymnasium.registry:
        gymnasium.register(ENVIRONMENT_ID, "ciphernav_jax.world.environment:ObstacleWorld")


register()
