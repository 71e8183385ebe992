"""The encoders of a view and of a map (paper, section 4, and its supplement).

Both take raw bytes and bring them to unit range themselves, so that nobody else has to know how.
"""

import jax.numpy as jnp
import numpy as np
from flax import nnx
from jaxtyping import Array, Float, UInt8

from ciphernav_jax.models.convolution import Convolution

VIEW_FEATURES = 32
MAP_FEATURES = 128

# Mean and standard deviation of red, green and blue over rendered views: public constants.
PIXEL_MEAN = np.array([105.0, 84.0, 78.0], np.float32)
PIXEL_SPREAD = np.array([22.0, 25.0, 28.0], np.float32)

# The largest code of a map. Squared loss learns the map much faster from values in [0, 1].
MAP_SCALE = np.float32(4)


class ViewEncoder(nnx.Module):
    """A camera's or the agent's view to 32 features; one encoder serves all five views.

    88,562 parameters: 456 + 906 in two 5 x 5 convolutions of stride 2, 83,072 + 4,128 in two
    linear layers, ReLU between all four.
    """

    def __init__(self, rngs: nnx.Rngs):
        he = nnx.initializers.he_normal()
        self.near = Convolution(3, 6, size=5, stride=2, block=14, rngs=rngs)
        self.far = Convolution(6, 6, size=5, stride=2, block=6, rngs=rngs)
        self.hidden = nnx.Linear(648, 128, kernel_init=he, rngs=rngs)
        self.features = nnx.Linear(128, VIEW_FEATURES, kernel_init=he, rngs=rngs)

    def __call__(self, views: UInt8[Array, "n 45 60 3"]) -> Float[Array, "n 32"]:
        """Encode views. Takes uint8[n, 45, 60, 3], returns float32[n, 32]."""
        x = (views.astype(jnp.float32) - PIXEL_MEAN) / PIXEL_SPREAD
        x = nnx.relu(self.near(x))
        x = nnx.relu(self.far(x))
        x = nnx.relu(self.hidden(x.reshape(len(x), -1)))
        return self.features(x)


class MapEncoder(nnx.Module):
    """The agent's map to 128 features; 26,496 parameters: 1,664 + 8,320 + 16,512."""

    def __init__(self, rngs: nnx.Rngs):
        he = nnx.initializers.he_normal()
        self.first = nnx.Linear(25, 64, kernel_init=he, rngs=rngs)
        self.second = nnx.Linear(64, 128, kernel_init=he, rngs=rngs)
        self.features = nnx.Linear(128, MAP_FEATURES, kernel_init=he, rngs=rngs)

    def __call__(self, maps: UInt8[Array, "n 25"]) -> Float[Array, "n 128"]:
        """Encode maps. Takes uint8[n, 25] (0 free, 1 agent, 2 goal, 4 wall), returns float32[n, 128]."""
        x = maps.astype(jnp.float32) / MAP_SCALE
        x = nnx.relu(self.first(x))
        x = nnx.relu(self.second(x))
        return self.features(x)
