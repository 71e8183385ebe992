"""The action classifier: the network that is trained and used on secrets."""

import itertools
from collections.abc import Callable

from flax import nnx
from jaxtyping import Array, Float

from ciphernav_jax.models.encoders import MAP_FEATURES, VIEW_FEATURES

FEATURES = 5 * VIEW_FEATURES + MAP_FEATURES
ACTIONS = 5

# PyTorch's default: uniform within 1/sqrt(fan in). A third of the variance of He's, which the
# quick recipe for squared loss needs: at its learning rate He's diverged.
MODEST = nnx.initializers.variance_scaling(1 / 3, "fan_in", "uniform")


class ActionClassifier(nnx.Module):
    """288 features to five logits: stop, up, down, left, right.

    46,373 parameters: 36,992 + 8,256 + 1,040 + 85 in four linear layers, ReLU between. The
    features are those of bottom_left, bottom_right, top_left, top_right, the agent's view (32
    each) and the map (128), in this order.

    Args:
        rngs: source of the initial weights.
        kernel_init: how to draw them.
    """

    def __init__(self, rngs: nnx.Rngs, kernel_init: Callable = MODEST):
        widths = (FEATURES, 128, 64, 16, ACTIONS)
        self.layers = nnx.List(
            nnx.Linear(inputs, outputs, kernel_init=kernel_init, rngs=rngs)
            for inputs, outputs in itertools.pairwise(widths)
        )

    def __call__(self, features: Float[Array, "n 288"]) -> Float[Array, "n 5"]:
        """Action logits. Takes float32[n, 288], returns float32[n, 5]."""
        for layer in self.layers[:-1]:
            features = nnx.relu(layer(features))
        return self.layers[-1](features)
