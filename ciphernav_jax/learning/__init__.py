"""Training in secret on columns that owners hold, whatever the data set. In reading order:

- `progress`: a bar for what a training reports.
- `storage`: pytrees in files, and checkpoints that survive a kill.
- `sgd`: the network, the recipe, and a step: ordinary JAX.
- `columns`: columns, who holds them, and the samples of a batch.
- `fitting`: the training itself, in plaintext or under secret sharing.
"""

from ciphernav_jax.learning.columns import Column, SplitTable
from ciphernav_jax.learning.fitting import fit
from ciphernav_jax.learning.sgd import Model, Sgd
from ciphernav_jax.learning.storage import Checkpoint

__all__ = ["Checkpoint", "Column", "Model", "Sgd", "SplitTable", "fit"]
