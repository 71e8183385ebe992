"""One rule for each primitive: what a JAX operation becomes when some of its operands are secret.

What has no rule is refused by `secure` with its name and place in the user's program. In import order:

- `registry`: `RULES`, and how a rule is called; `rule`, `composed`.
- `operands`: secret or public, with the precision that an operation needs.
- `movement`: the same operation on the shares.
- `linear`: sums and differences, local.
- `products`: multiplication, contraction, powers, quotients by public numbers.
- `comparisons`: orders, equality, signs, conversion.
- `selection`: by a bit; maximum, minimum, absolute value.
- `logic`: on bits.
- `control_flow`: scan, while and cond.
- `sorting`: the largest and the smallest of many.
"""

from ciphernav_jax.secret.rules import (  # noqa: F401  (each registers its rules)
    comparisons,
    control_flow,
    linear,
    logic,
    movement,
    products,
    selection,
    sorting,
)
from ciphernav_jax.secret.rules.registry import CONTROL_FLOW, MOVES, RULES, Unsupported, composed, rule

__all__ = ["CONTROL_FLOW", "MOVES", "RULES", "Unsupported", "composed", "rule"]
