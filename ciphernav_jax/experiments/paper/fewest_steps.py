"""How few steps of secret training from scratch pass the paper's 96.6 % (2 parties) and 96.9 % (5 parties).

The paper: 600 epochs, 3 days on a GPU. Ours: 150 steps of 500 samples (`fewest-P`), and one pass over the
training samples, 212 steps (`one-pass-P`). Both were chosen on the validation set, where the first reaches
97.1 % in the mean over seeds.

    python -m ciphernav_jax.experiments.paper.fewest_steps       # about 10 minutes on two cores

The encoders are those of the row `plaintext`, trained before.
"""

from ciphernav_jax.experiments.paper.accuracy import PLAINTEXT
from ciphernav_jax.experiments.paper.runs import Row, RowOptions, script
from ciphernav_jax.navigation.classifier import FreshClassifier

FEWEST = FreshClassifier(steps=150, learning_rate=1.2, chunk=50)
ONE_PASS = FreshClassifier(steps=212, learning_rate=1.2)

ROWS = tuple(
    Row(f"{name}-{parties}", "secret", recipe, parties)
    for name, recipe in (("fewest", FEWEST), ("one-pass", ONE_PASS))
    for parties in (2, 5)
)

if __name__ == "__main__":
    script(__doc__, ROWS, RowOptions(rows=[row.name for row in ROWS]), [PLAINTEXT])
