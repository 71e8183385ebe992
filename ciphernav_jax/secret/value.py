"""`Value`: one party's share of a secret inside a program, with what has been computed from it already.

A product has more fractional bits than its factors. It is not truncated at once: a value carries its own
`frac_bits`, sums are taken at full precision, and the truncation waits for the operation that needs it, which
may absorb it (ReLU and selection do). A value also remembers its opening under a mask and the bit x > 0, so
that each is computed once however often it is used: in the backward pass, say.
"""

from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import UInt64

from ciphernav_jax import ring
from ciphernav_jax.protocols import Protocol, compare, ideal, masked, multiply, truncate
from ciphernav_jax.protocols import relu as relus
from ciphernav_jax.protocols.dealer import Dealer
from ciphernav_jax.protocols.masked import Masked
from ciphernav_jax.protocols.party import from_party_zero
from ciphernav_jax.ring.linear import DimensionNumbers
from ciphernav_jax.secret.places import Place

if TYPE_CHECKING:
    from ciphernav_jax.secret.witness import Notes, Row, Witness

# A value with more fractional bits than this would lose its integer part in the ring.
MAX_FRAC_BITS = 62


@dataclass(frozen=True)
class Context:
    """What every operation in a program needs: the variants, where randomness comes from, who watches, and
    the line of the user's function that it comes from.
    """

    protocol: Protocol
    dealer: Dealer
    witness: "Witness | None" = None
    place: Place | None = None

    def notes(self) -> "Notes | None":
        """What the witness of this part of the program has noted."""
        return self.witness and self.witness.notes()


class Value:
    """One party's share of a secret, in the value's plain shape.

    Attributes:
        context: the program's protocol and dealer.
        frac_bits: the value is the shares' signed sum / 2^frac_bits.
        share: uint64[shape], this party's additive share.
        form: the value as a `Masked` value where one is known.
        reference, row: where a witness stands beside the program, what the value should be, and the
            equation that made it (`secret.witness`).
    """

    reference: Array | None = None
    row: "Row | None" = None

    def __init__(
        self, context: Context, frac_bits: int, *, share: Array | None = None, form: Masked | None = None
    ):
        self.context = context
        self.frac_bits = frac_bits
        self.form = form
        if share is not None:
            self.share = share

    @cached_property
    def share(self) -> UInt64[Array, "..."]:
        assert self.form is not None
        return self.form.share()

    @property
    def shape(self) -> tuple[int, ...]:
        return self.share.shape

    def _new(self, frac_bits: int, share: Array) -> "Value":
        return Value(self.context, frac_bits, share=share)

    # --- precision ---

    @cached_property
    def settled(self) -> "Value":
        """This value with at most the protocol's fractional bits: truncated if it has more."""
        protocol = self.context.protocol
        shift = self.frac_bits - protocol.frac_bits
        if shift <= 0:
            return self
        dealer, share, form = self.context.dealer, None, None
        match protocol.truncation:
            case "probabilistic":
                form = truncate.probabilistic(dealer, self.share, shift)
            case "nearest":
                form = truncate.nearest(dealer, self.share, shift)
            case "floor":
                form = truncate.floor(dealer, self.share, shift)
            case "wrap-count":
                share = truncate.wrap_count(dealer, self.share, shift)
            case "local":
                share = truncate.local(self.share, shift)
            case "ideal":
                share = ideal.ideal_truncation(dealer, self.share, shift)
        settled = Value(self.context, protocol.frac_bits, share=share, form=form)
        if self.context.witness:
            self.context.witness.truncated(self, shift, settled)
        return settled

    def lifted(self, frac_bits: int) -> "Value":
        """This value with more fractional bits: shifted left. Local, exact."""
        if frac_bits == self.frac_bits:
            return self
        return self._new(frac_bits, self.share << (frac_bits - self.frac_bits))

    def scaled(self, exponent: int) -> "Value":
        """This value times 2^-exponent: the same shares read with other fractional bits. Local, exact."""
        if self.frac_bits + exponent > MAX_FRAC_BITS and self.settled is not self:
            return self.settled.scaled(exponent)
        frac_bits = self.frac_bits + exponent
        if frac_bits < 0:
            return self._new(0, self.share << -frac_bits)
        return Value(self.context, frac_bits, share=self.share)

    # --- linear operations, all local ---

    def add(self, other: "Value") -> "Value":
        a, b = align(self, other)
        return a._new(a.frac_bits, a.share + b.share)

    def add_public(self, encoded: UInt64[Array, "..."]) -> "Value":
        """Adds a public array that is encoded with this value's fractional bits."""
        return self._new(self.frac_bits, self.share + from_party_zero(encoded))

    def negated(self) -> "Value":
        return self._new(self.frac_bits, -self.share)

    # --- non-linear operations ---

    @cached_property
    def opened(self) -> Masked:
        """This value open under one uniform mask."""
        return masked.open_masked(self.context.dealer, self.share)

    @property
    def _circuit(self) -> compare.Circuit:
        """How this value's sign is found; integers keep the whole range."""
        protocol, sign_bit = self.context.protocol, 63
        if protocol.range_bits is not None and self.frac_bits:
            sign_bit = min(sign_bit, protocol.range_bits + self.frac_bits)
        layout = "words" if protocol.comparison == "masked-words" else "sliced"
        return compare.Circuit(layout, protocol.adder, sign_bit)

    @cached_property
    def positive(self) -> "Value":
        """The bit x > 0, with no fractional bits."""
        dealer = self.context.dealer
        match self.context.protocol.comparison:
            case "masked" | "masked-words":
                form = compare.positive(dealer, self.share, self._circuit)
            case "resharing":
                form = compare.resharing(dealer, self.share, self._circuit)
            case "ideal":
                return self._new(0, ideal.ideal_positive(dealer, self.share))
        return Value(self.context, 0, form=form)

    @cached_property
    def relu(self) -> "Value":
        """max(x, 0), truncated on the way where the truncation may be absorbed; keeps the bit x > 0."""
        protocol, dealer = self.context.protocol, self.context.dealer
        shift = max(self.frac_bits - protocol.frac_bits, 0)
        by_opening = protocol.comparison in ("masked", "masked-words") and protocol.multiplication == "beaver"
        if not by_opening or (shift and protocol.truncation != "probabilistic"):
            return self.positive.times(self)
        output, positive = relus.relu(dealer, self.share, shift, self._circuit)
        self.positive = Value(self.context, 0, form=positive)
        result = self._new(self.frac_bits - shift, output)
        if shift and self.context.witness:
            self.context.witness.truncated(self, shift, result, clipped=True)
        return result

    def is_bit(self) -> bool:
        """Whether this is a bit already open under a mask: products with it open nothing more for it."""
        return self.frac_bits == 0 and self.form is not None

    def times(self, other: "Value") -> "Value":
        """The elementwise product, with the fractional bits of both."""
        if self.context.protocol.multiplication == "ideal":
            a, b = self.settled, other.settled
            share = ideal.ideal_product(self.context.dealer, a.share, b.share, jnp.multiply)
            return self._new(a.frac_bits + b.frac_bits, share)
        if self.is_bit() or other.is_bit():
            bit, value = (self, other.settled) if self.is_bit() else (other, self.settled)
            left, right = bit.form, value.form or value.opened
        else:
            value, bit = self.settled, other.settled
            left, right = value.opened, bit.opened
        assert left is not None
        frac_bits = value.frac_bits + bit.frac_bits
        if value is bit:
            return self._new(frac_bits, multiply.square(self.context.dealer, value.opened))
        return self._new(frac_bits, multiply.multiply(self.context.dealer, left, right))

    def dot_general(self, other: "Value", dimension_numbers: DimensionNumbers) -> "Value":
        """The tensor product, with the fractional bits of both."""
        a, b, dealer = self.settled, other.settled, self.context.dealer
        if self.context.protocol.multiplication == "ideal":
            product = partial(ring.dot_general, dimension_numbers=dimension_numbers)
            share = ideal.ideal_product(dealer, a.share, b.share, product)
        else:
            share = multiply.dot_general(dealer, a.opened, b.opened, dimension_numbers)
        return self._new(a.frac_bits + b.frac_bits, share)


def align(*values: Value) -> tuple[Value, ...]:
    """The values with equal fractional bits: the most that any has, but at most those of a product."""
    limit = 2 * values[0].context.protocol.frac_bits
    values = tuple(v if v.frac_bits <= limit else v.settled for v in values)
    frac_bits = max(v.frac_bits for v in values)
    return tuple(v.lifted(frac_bits) for v in values)


def dyadic(constant: np.ndarray, bits: int) -> tuple[np.ndarray, int]:
    """Writes a public constant as m 2^-e: integers m (int64, |m| <= 2^bits) and the smallest such e.

    Exact for integers and powers of two, which then need no truncation after a product; otherwise the error
    relative to the largest entry is below 2^-bits, unless the constant is below 2^-(62 - 2 bits).
    """
    constant = np.asarray(constant, np.float64)
    if not np.all(np.isfinite(constant)):
        raise ValueError("cannot multiply a secret by a constant that is not finite (NaN or infinity)")
    largest = np.max(np.abs(constant), initial=0.0)
    if largest == 0:
        return np.zeros(constant.shape, np.int64), 0
    e = min(bits - int(np.ceil(np.log2(largest))), MAX_FRAC_BITS - bits)
    m = np.round(constant * 2.0**e).astype(np.int64)
    while e > -bits and np.any(m) and not np.any(m & 1):
        m, e = m >> 1, e - 1
    return np.asarray(m), e


def times_constant(x: Value, constant: np.ndarray) -> Value:
    """A secret times a public constant, with broadcasting. Local; the truncation, if any, is left pending."""
    m, e = dyadic(constant, x.context.protocol.frac_bits)
    if m.size and np.all(m == m.flat[0]) and m.flat[0] in (1, -1):
        x = x._new(x.frac_bits, jnp.broadcast_to(x.share, np.broadcast_shapes(x.shape, m.shape)))
        return (x if m.flat[0] == 1 else x.negated()).scaled(e)
    if x.frac_bits + e > 2 * x.context.protocol.frac_bits:
        x = x.settled
    return x._new(x.frac_bits, x.share * m.view(np.uint64)).scaled(e)


def times_public(x: Value, public: Array) -> Value:
    """A secret times a public array, with broadcasting. Integers and bools need no truncation."""
    if not jnp.issubdtype(public.dtype, np.floating):
        return x._new(x.frac_bits, x.share * ring.encode(public, 0))
    x = x.settled
    bits = x.context.protocol.frac_bits
    return x._new(x.frac_bits + bits, x.share * ring.encode(public, bits))


def where(condition: Value, on_true: Value, on_false: Value) -> Value:
    """Selection by a secret bit: on_false + condition (on_true - on_false)."""
    a, b = align(on_true, on_false)
    return condition.times(a.add(b.negated())).add(b)


def dot_public(
    x: Value, public: Array | np.ndarray, dimension_numbers: DimensionNumbers, *, public_left: bool
) -> Value:
    """The tensor product of a secret and a public array. Local; the truncation is left pending."""
    x = x.settled
    bits = x.context.protocol.frac_bits
    if isinstance(public, np.ndarray):
        m, e = dyadic(public, bits)
        encoded = jnp.asarray(m.view(np.uint64))
    else:
        e = bits if jnp.issubdtype(public.dtype, np.floating) else 0
        encoded = ring.encode(public, e)
    left, right = (encoded, x.share) if public_left else (x.share, encoded)
    return x._new(x.frac_bits, ring.dot_general(left, right, dimension_numbers)).scaled(e)
