"""The networks, in Flax nnx; the paper's are two encoders and the action classifier.

- `convolution`: a strided convolution written as one matrix product.
- `encoders`: a view's pixels, or a map, to features.
- `classifier`: the features of five views and a map to five action logits.
- `navigator`: the three together, trained end to end in plaintext.
- `sight`: where straight ahead an obstacle stands, in the robot's own view; not the paper's.
"""

from ciphernav_jax.models.classifier import ActionClassifier
from ciphernav_jax.models.convolution import Convolution
from ciphernav_jax.models.encoders import MapEncoder, ViewEncoder
from ciphernav_jax.models.navigator import Navigator
from ciphernav_jax.models.sight import Sight

__all__ = ["ActionClassifier", "Convolution", "MapEncoder", "Navigator", "Sight", "ViewEncoder"]
