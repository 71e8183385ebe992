"""The robot's own eyes: in which of the cells straight ahead the nearest obstacle stands."""

from flax import nnx
from jaxtyping import Array, Float, UInt8

from ciphernav_jax.models.encoders import VIEW_FEATURES, ViewEncoder

REACH = 4
"""Cells ahead that it tells of: as many as there can be."""


class Sight(nnx.Module):
    """A view to four logits, one for each cell ahead, above 0 where an obstacle is seen to stand.

    That is the nearest one; what it hides is not guessed. A `ViewEncoder` of its own and a linear layer,
    88,694 parameters. It stays with the robot, as its views do.
    """

    def __init__(self, rngs: nnx.Rngs):
        self.encoder = ViewEncoder(rngs)
        self.ahead = nnx.Linear(VIEW_FEATURES, REACH, rngs=rngs)

    def __call__(self, views: UInt8[Array, "n 45 60 3"]) -> Float[Array, "n 4"]:
        """Takes uint8[n, 45, 60, 3], returns float32[n, 4]."""
        return self.ahead(self.encoder(views))
