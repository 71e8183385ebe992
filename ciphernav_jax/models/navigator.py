"""Encoders and classifier together, as trained end to end in plaintext."""

from flax import nnx

from ciphernav_jax.models.classifier import ActionClassifier
from ciphernav_jax.models.encoders import MapEncoder, ViewEncoder


class Navigator(nnx.Module):
    """A view encoder, a map encoder and an action classifier. 161,431 parameters."""

    def __init__(self, rngs: nnx.Rngs):
        self.view_encoder = ViewEncoder(rngs)
        self.map_encoder = MapEncoder(rngs)
        self.classifier = ActionClassifier(rngs, kernel_init=nnx.initializers.he_normal())
