"""The classifier trained as the paper says: SGD, learning rate 0.01, squared loss, on features as they are.

The paper: 600 epochs with batch 500 end at 96.6 % (2 parties), 96.9 % (5 parties); 97.1 % in plaintext. Its
batch can be read in two ways: 500 samples, 127,000 steps, or 500 environments, 18,000 steps of about 3,500
samples.

    python -m experiments paper paper_recipe       # 40 minutes on two cores

Both readings run whole in plaintext, and the first, its 600 epochs, under secret sharing with two parties.
The encoders are those of the row `plaintext`.
"""

from ciphernav_jax.navigation.classifier import FreshClassifier
from experiments.paper.accuracy import PLAINTEXT
from experiments.paper.runs import Row, RowOptions, script


def _sgd(steps: int, batch: int) -> FreshClassifier:
    return FreshClassifier(
        steps=steps,
        batch=batch,
        learning_rate=0.01,
        momentum=0.0,
        schedule="constant",
        standardised=False,
        chunk=steps // 60,
    )


ROWS = (
    Row("paper-recipe-samples", "plaintext-classifier", _sgd(127_200, 500)),
    Row("paper-recipe-environments", "plaintext-classifier", _sgd(18_000, 3_500)),
    Row("paper-recipe-secret-2", "secret", _sgd(127_200, 500), 2),
)


def main() -> None:
    """Train, drive, and tabulate the rows asked for."""
    script(__doc__, ROWS, RowOptions(rows=[row.name for row in ROWS], seeds=[0]), [PLAINTEXT])
