"""How few steps of secret training from scratch pass the paper's 96.6 % (2 parties) and 96.9 % (5 parties).

The paper: 600 epochs, 3 days on a GPU. Ours: 200 steps of 500 samples, less than one pass over the training
samples. Chosen on the validation set, with earlier encoders.

    python -m experiments paper fewest_steps       # 3 minutes on two cores

The encoders are those of the row `plaintext`, trained before.
"""

from ciphernav_jax.navigation.classifier import FreshClassifier
from experiments.paper.accuracy import PLAINTEXT
from experiments.paper.runs import Row, RowOptions, script

FEWEST = FreshClassifier(steps=200, learning_rate=1.2, chunk=50)

ROWS = tuple(Row(f"fewest-{parties}", "secret", FEWEST, parties) for parties in (2, 5))


def main() -> None:
    """Train, drive, and tabulate the rows asked for."""
    script(__doc__, ROWS, RowOptions(rows=[row.name for row in ROWS]), [PLAINTEXT])
