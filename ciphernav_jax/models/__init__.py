"""The networks, in Flax nnx; the paper's are two encoders and the action classifier.

- `convolution`: a strided convolution written as one matrix product.
- `encoders`: a view's pixels, or a map, to features.
- `classifier`: the features of five views and a map to five action logits.
- `navigator`: the three together, trained end to end in plaintext.
- `sight`: where straight ahead an obstacle stands, in the robot's own view; not the paper's.
"""

from ciphernav_jax import extras

extras.require("navigation", "ciphernav_jax.models")

from ciphernav_jax.models.classifier import ActionClassifier  # noqa: E402
from ciphernav_jax.models.convolution import Convolution  # noqa: E402
from ciphernav_jax.models.encoders import MapEncoder, ViewEncoder  # noqa: E402
from ciphernav_jax.models.navigator import Navigator  # noqa: E402
from ciphernav_jax.models.sight import Sight  # noqa: E402

__all__ = ["ActionClassifier", "Convolution", "MapEncoder", "Navigator", "Sight", "ViewEncoder"]
