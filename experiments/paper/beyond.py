"""Past the paper: at least 99.8 % of the episodes, and none that ends without a crash away from its goal.

The paper has 97.1 % in plaintext, 96.6 % with 2 parties, 96.9 % with 5; of 4,500 episodes 10 or 11 end lost.

    python -m experiments paper beyond     # 25 minutes on two cores, after `accuracy`

The rows `longer-...` are those of `accuracy` but for the classifier's recipe: twice the steps, and as many
errands as the encoders have had. In the rows `beyond-...` these classifiers drive, with parties, networks
and protocols as they are. What is different is the robot: it uses what it alone knows, its map, its place and
goal, where it has been, and what it sees straight ahead (`navigation.rollout.Careful`). For that it has a
network of its own, trained in plaintext on its own views (`navigation.sight`). `alone` shows what all this is
worth without the parties: nobody answers, and the robot finds its way with map, memory and eyes. All was
chosen on validation sets.
"""

from ciphernav_jax.navigation.classifier import FreshClassifier
from ciphernav_jax.navigation.sight import Looking
from experiments.paper import accuracy
from experiments.paper.runs import Row, RowOptions, script

LONGER = FreshClassifier(steps=6360, errands=4)
EYES = Looking()

ROWS = (
    Row("longer-plaintext", "plaintext-classifier", LONGER),
    *(Row(f"longer-{p}", "secret", LONGER, p) for p in (2, 5)),
    Row("beyond-plaintext", "plaintext-classifier", drives="longer-plaintext", eyes=EYES),
    *(Row(f"beyond-{p}", "secret", parties=p, drives=f"longer-{p}", eyes=EYES) for p in (2, 5)),
    Row("alone", "alone", eyes=EYES),
)


def main() -> None:
    """Train, drive, and tabulate the rows asked for."""
    script(__doc__, ROWS, RowOptions(rows=[row.name for row in ROWS]), accuracy.ROWS)
