"""The robot's own eyes: whether an obstacle stands in the cell ahead."""

from flax import nnx
from jaxtyping import Array, Float, UInt8

from ciphernav_jax.models.encoders import VIEW_FEATURES, ViewEncoder


class Sight(nnx.Module):
    """A view to one logit, above 0 where an obstacle stands in the next cell; 88,595 parameters.

    A `ViewEncoder` of its own and a linear layer. It stays with the robot, as its views do.
    """

    def __init__(self, rngs: nnx.Rngs):
        self.encoder = ViewEncoder(rngs)
        self.ahead = nnx.Linear(VIEW_FEATURES, 1, rngs=rngs)

    def __call__(self, views: UInt8[Array, "n 45 60 3"]) -> Float[Array, " n"]:
        """Takes uint8[n, 45, 60, 3], returns float32[n]."""
        return self.ahead(self.encoder(views))[:, 0]
