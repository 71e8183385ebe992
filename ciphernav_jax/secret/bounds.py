"""How large a ring integer may be: the contract of `docs/guide/ranges.md`, in integers.

With f fractional bits, what is shared and each product before its truncation stay below 2^(62 - 2f) in
magnitude, results below 2^(62 - f), each by at least a unit of the last place. All bounds are of the ring
integer, which is the value times 2^frac_bits; they are Python's integers, and inclusive.
"""

import numpy as np

from ciphernav_jax.protocols import Protocol
from ciphernav_jax.protocols.truncate import VARIANTS

SIGNED = 2**63 - 1
"""The largest magnitude whose sign the ring shows."""

MASK = 2**61
"""What public numbers stand for that are larger and that secrets are added to or selected beside: a secret,
two of these, and the difference of such sums stay within the ring.
"""

COMPARED = 2**62 - 2**10
"""The same for those that secrets are compared with: more than any result is. Exact in float64."""


def shared(protocol: Protocol, dtype: np.dtype) -> int:
    """Of what is shared: floats within 2^(62 - 2f), integers within 2^62 and their type's range."""
    if dtype.kind == "b":
        return 1
    if np.issubdtype(dtype, np.integer):
        info = np.iinfo(dtype)
        return min(2**62, max(-int(info.min), int(info.max)))
    return 2 ** (62 - protocol.frac_bits) - 1


def product(protocol: Protocol, frac_bits: int) -> int:
    """Of a product that waits for its truncation, with so many fractional bits."""
    shift = frac_bits - protocol.frac_bits
    return shared(protocol, np.dtype(float)) << shift if shift > 0 else resting(protocol, frac_bits)


def resting(protocol: Protocol, frac_bits: int) -> int:
    """Of a value that waits for no truncation: integers have the whole ring."""
    return 2**62 - 2**protocol.frac_bits if frac_bits else SIGNED


def at_rest(protocol: Protocol, dtype: np.dtype) -> int:
    """Of a result of that type."""
    if dtype.kind == "b" or (np.issubdtype(dtype, np.integer) and dtype.itemsize < 8):
        return shared(protocol, dtype)
    return resting(protocol, 0 if np.issubdtype(dtype, np.integer) else protocol.frac_bits)


def truncatable(protocol: Protocol, shift: int) -> int:
    """The largest that can be truncated by so many bits: below 2^62, with room for a half unit."""
    return 2**62 - (1 << shift >> 1 if VARIANTS[protocol.truncation].adds_half else 0) - 1
