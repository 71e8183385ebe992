"""What parties compute on shares, each protocol written once as the program of one party (`parties`).

In import order:
- `suite`: `Protocol`, the choice of variants.
- `ideal`: what a trusted third party would compute, for sweeps; not protocols.
- `masked`: values opened under a mask.
- `multiply`: Beaver products of any bilinear form, square, and conjunction of words.
- `adders`: carries and borrows of binary adders.
- `convert`: arithmetic to binary and back.
- `compare`: the sign of a value.
- `truncate`: back to f fractional bits after a product.
- `relu`: ReLU and selection.

The adversary is semi-honest: parties follow the program and may pool what they see, up to P - 1 of them; the
dealer is trusted.
"""

from ciphernav_jax.protocols.suite import Protocol

__all__ = ["Protocol"]
