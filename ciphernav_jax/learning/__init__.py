"""Training in secret on columns that owners hold, whatever the data set. In reading order:

- `progress`: a bar for what a training reports.
- `storage`: pytrees in files, and checkpoints that survive a kill.
- `sgd`: the network, the recipe, and a step: ordinary JAX.
- `table`: columns, who holds them, and the samples of a batch.
- `fitting`: the training itself, in plaintext or under secret sharing.
"""

from ciphernav_jax.learning.fitting import fit
from ciphernav_jax.learning.sgd import Network, Sgd
from ciphernav_jax.learning.storage import Checkpoint
from ciphernav_jax.learning.table import Column, Table

__all__ = ["Checkpoint", "Column", "Network", "Sgd", "Table", "fit"]
