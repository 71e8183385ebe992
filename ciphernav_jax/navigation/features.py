"""Each party encodes its own views; the result is the classifier's input, slot by slot.

A view that stands once in the data set is encoded once: what a party computes from the same
pixels is the same. The tables below are indexed only where the owner of a slot does the indexing;
what is shared afterwards has a row per environment or per sample, so that equal views are not
seen to be equal.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx
from numpy.typing import NDArray

from ciphernav_jax.models import MapEncoder, Sight, ViewEncoder
from ciphernav_jax.models.encoders import MAP_FEATURES, VIEW_FEATURES
from ciphernav_jax.navigation.methods import Method
from ciphernav_jax.navigation.owners import CAMERAS
from ciphernav_jax.navigation.samples import Samples
from ciphernav_jax.world.dataset import Dataset
from ciphernav_jax.world.grid import CELLS, WALLS, map_code

Floats = NDArray[np.float32]

BLOCK = 4096  # views per call of a network
PIECE = 64  # views at a time within a call, so that they stay in the processor's cache


@dataclass(frozen=True)
class Features:
    """The features of a data set as a method sees it; a slot that it has not is zero throughout.

    Attributes:
        cameras: one float32[N, 32] for each of the four cameras.
        views: float32[V, 32], the robot's views, each once.
        view_index: int32[N, 25, 4], the row of `views` for each (cell, heading), -1 where not free.
        maps: float32[12, 25, 25, 128], by layout, robot's cell and goal.
        layout, goal: int[N].
    """

    cameras: tuple[Floats, ...]
    views: Floats
    view_index: NDArray[np.int32]
    maps: Floats
    layout: NDArray[np.uint8]
    goal: NDArray[np.uint8]

    def robot(self, env: NDArray, cell: NDArray, heading: NDArray, goal: NDArray) -> tuple[Floats, Floats]:
        """The two slots of the robot: its view's features float32[S, 32] and its map's float32[S, 128]."""
        view = self.views[self.view_index[env, cell, heading]]
        return view, self.maps[self.layout[env], cell, goal]

    def slots(self, env: NDArray, cell: NDArray, heading: NDArray) -> tuple[Floats, ...]:
        """All six slots on the way to the data set's goals, in the order of the classifier's input."""
        return (*(camera[env] for camera in self.cameras), *self.robot(env, cell, heading, self.goal[env]))


def encode(dataset: Dataset, method: Method, view_encoder: ViewEncoder, map_encoder: MapEncoder) -> Features:
    """Every owner encodes what it sees of a data set."""
    index = np.asarray(dataset.agent)
    views = np.zeros((1, VIEW_FEATURES), np.float32)
    if method.cameras or method.agent_view:
        views = of_views(view_encoder, dataset.views)
    cameras = (np.zeros((len(index), VIEW_FEATURES), np.float32),) * len(CAMERAS)
    if method.cameras:
        cameras = tuple(views[column] for column in dataset.cameras.T)
    if not method.agent_view:
        views, index = views[:1], np.zeros_like(index)
    return Features(cameras, views, index, _encode_maps(map_encoder), dataset.layout, dataset.goal)


def of_views(network: ViewEncoder | Sight, views: NDArray[np.uint8]) -> Floats:
    """float32[V, width]: what a network makes of each view, uint8[V, 45, 60, 3]."""
    blocks = []
    for first in range(0, len(views), BLOCK):
        block = np.asarray(views[first : first + BLOCK])
        padded = np.pad(block, ((0, -len(block) % PIECE), (0, 0), (0, 0), (0, 0)))
        blocks.append(np.asarray(_of_block(network, jnp.asarray(padded)))[: len(block)])
    return np.concatenate(blocks)


class Scale(NamedTuple):
    """How an owner standardises a slot: `mean` and `spread`, float32 vectors of the slot's width."""

    mean: Floats
    spread: Floats

    def __call__(self, features: Floats) -> Floats:
        """(features - mean) / spread."""
        return (features - self.mean) / self.spread


def unscaled() -> tuple[Scale, ...]:
    """The scales that change nothing: what a classifier trained together with its encoders expects."""
    widths = [VIEW_FEATURES] * (len(CAMERAS) + 1) + [MAP_FEATURES]
    return tuple(Scale(np.zeros(width, np.float32), np.ones(width, np.float32)) for width in widths)


def fit_scales(features: Features, samples: Samples) -> tuple[Scale, ...]:
    """One scale per slot, each from nothing but its owner's features of the training samples."""
    slots = (*features.cameras, *features.robot(samples.env, samples.cell, samples.heading, samples.goal))
    return tuple(Scale(slot.mean(0), np.maximum(slot.std(0), np.float32(1e-2))) for slot in slots)


def standardise(features: Features, scales: tuple[Scale, ...]) -> Features:
    """Every owner applies its slot's scale."""
    *camera_scales, view_scale, map_scale = scales
    cameras = tuple(scale(camera) for scale, camera in zip(camera_scales, features.cameras, strict=True))
    return replace(features, cameras=cameras, views=view_scale(features.views), maps=map_scale(features.maps))


@nnx.jit
def _of_block(network: ViewEncoder | Sight, views: jax.Array) -> jax.Array:
    return jax.lax.map(network.__call__, views.reshape(-1, PIECE, *views.shape[1:])).reshape(len(views), -1)


def _encode_maps(encoder: MapEncoder) -> Floats:
    cells = np.arange(CELLS)
    codes = map_code(WALLS[:, None, None], cells[:, None], cells)
    features = encoder(jnp.asarray(codes.reshape(-1, CELLS)))
    return np.asarray(features).reshape(*codes.shape[:-1], -1)
