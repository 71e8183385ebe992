"""`Value`: one party's share of a secret inside a program, with what has been computed from it already.

A product has more fractional bits than its factors. It is not truncated at once: a value carries its own
`frac_bits`, sums are taken at full precision, and the truncation waits for the operation that needs it, which
may absorb it (ReLU and selection do). A value also remembers its opening under a mask and the bit x > 0, so
that each is computed once however often it is used: in the backward pass, say.

A value that waits must still be truncatable when its turn comes. So each carries a static `bound`, from the
contract and from what was done to it (`secret.bounds`), and what could leave the ring is truncated first.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jaxtyping import UInt64

from ciphernav_jax import ring
from ciphernav_jax.jax_private import ClosedJaxpr, JaxprEqn
from ciphernav_jax.parties.dealer import Dealer
from ciphernav_jax.parties.party import from_party_zero
from ciphernav_jax.parties.requests import Zero
from ciphernav_jax.protocols import Protocol, compare, ideal, masked, multiply, truncate
from ciphernav_jax.protocols import relu as relus
from ciphernav_jax.protocols.masked import Masked
from ciphernav_jax.ring.forms import Form
from ciphernav_jax.secret import bounds
from ciphernav_jax.secret.findings import Findings
from ciphernav_jax.secret.places import UNKNOWN, Place

if TYPE_CHECKING:
    from ciphernav_jax.secret.witness import Notes, Row, Witness

# A value with more fractional bits than this would lose its integer part in the ring.
MAX_FRAC_BITS = 62

Move = Callable[[Array], Array]


@dataclass(frozen=True)
class Context:
    """What every operation in a program needs.

    Attributes:
        protocol: the variants.
        dealer: where randomness comes from.
        evaluator: `evaluator(context, jaxpr, operands)` evaluates a closed jaxpr.
        witness: who watches.
        place: the line of the user's function that it comes from.
        eqn: the equation that is evaluated, with the shapes and types of operands and results.
        composed: whether that is part of the rule of another one (`secret.rules.registry.composed`).
        findings: what was found of public numbers in this part.
    """

    protocol: Protocol
    dealer: Dealer
    evaluator: "Callable[[Context, ClosedJaxpr, list[Any]], list[Any]]"
    witness: "Witness | None" = None
    place: Place = UNKNOWN
    eqn: JaxprEqn | None = None
    composed: bool = False
    findings: list[Findings] = field(default_factory=list)

    def evaluate(self, jaxpr: ClosedJaxpr, operands: list[Any]) -> list[Any]:
        """The results of a jaxpr on secrets and public arrays."""
        return self.evaluator(self, jaxpr, operands)

    @property
    def result(self) -> Any:
        """The shape and type that JAX gives the first result of the equation."""
        assert self.eqn is not None
        return self.eqn.outvars[0].aval

    def find(self, problem: str, found: Array) -> None:
        """A public number has met a secret; `found` says where it has this problem."""
        self.findings.append(Findings.of(problem, self.place, found))

    def notes(self) -> "tuple[Notes | None, Findings]":
        """What the witness of this part of the program has noted, and what was found."""
        return self.witness and self.witness.notes(), Findings.joined(self.findings)


class Value:
    """One party's share of a secret, in the value's plain shape.

    Attributes:
        context: the program's protocol and dealer.
        frac_bits: the value is the shares' signed sum / 2^frac_bits.
        bound: no entry's signed sum is larger in magnitude; known while tracing.
        share: uint64[shape], this party's additive share.
        form: the value as a `Masked` value where one is known.
        public: the ring integers, of a value that everybody knows.
        excess: ring integers with the protocol's fractional bits that `relu` adds; see `add`.
        fresh: whether each entry's shares are known to be uniform, whatever the value.
        in_range: this integer in the ranges of types, of those that were asked for; see `secret.integers`.
        coarse: the same with fewer fractional bits, of a sum or of an integer that is larger than a result
            may be before a constant scales it down; see `summed` and `at_most`.
        doubled: whether this is a difference of two values that are compared.
        choice: the two operands of which this is the larger one, or with False the smaller one.
        poisoned: whether an entry stands for no number, where only the run knows: it read NaN, out of range.
        reference, row: where a witness stands beside the program, what the value should be, and the
            equation that made it (`secret.witness`).
    """

    reference: Array | None = None
    row: "Row | None" = None
    choice: "tuple[Value | Array | np.ndarray, Value | Array | np.ndarray, bool] | None" = None
    poisoned: Array | None = None

    def __init__(
        self,
        context: Context,
        frac_bits: int,
        bound: int,
        *,
        share: Array | None = None,
        form: Masked | None = None,
        public: Array | None = None,
        settle: Callable[[], "Value"] | None = None,
        excess: Array | None = None,
        fresh: bool = False,
        coarse: Callable[[], "Value"] | None = None,
    ):
        self.context = context
        self.frac_bits = frac_bits
        self.bound = bound if self.waits else min(bound, bounds.resting(context.protocol, frac_bits))
        self.form = form
        self.public = public
        self.in_range: dict[np.dtype, Value] = {}
        self.excess = excess
        self.fresh = fresh
        self.coarse = coarse
        self.doubled = False
        self._settle = settle
        self._settled: Value | None = None
        self._told = False
        # What it was moved out of, and how it goes back; and what a public number was added to, and which.
        self._source: tuple[Value, Move | None] | None = None
        self._added: tuple[Value, Array] | None = None
        if share is not None:
            self.share = share

    @cached_property
    def share(self) -> UInt64[Array, "..."]:
        if self.public is not None:
            return from_party_zero(self.public)
        assert self.form is not None
        return self.form.share()

    @property
    def shape(self) -> tuple[int, ...]:
        return self.share.shape

    def like(self, share: Array) -> "Value":
        """Another value of this precision and bound."""
        return Value(self.context, self.frac_bits, self.bound, share=share)

    def at_most(self, bound: int, frac_bits: int) -> "Value":
        """This value, of which the contract says that with so many fractional bits it is within the bound.
        Where a constant scales it down at once, it need not be.
        """
        if self.bound_at(frac_bits) <= bound:
            return self
        protocol = self.context.protocol
        most = min(self.bound, bounds.truncatable(protocol, 2 * protocol.frac_bits))
        return Value(
            self.context,
            self.frac_bits,
            bound >> frac_bits - self.frac_bits,
            share=self.share,
            coarse=self.coarse or (lambda: Value(self.context, self.frac_bits, most, share=self.share)),
        )

    def bound_at(self, frac_bits: int) -> int:
        """The bound with other fractional bits."""
        shift = frac_bits - self.frac_bits
        return self.bound << shift if shift >= 0 else -(-self.bound >> -shift)

    def moved(self, move: Move, back: Move | None = None) -> "Value":
        """The same entries elsewhere, repeated, left out, or negated, as `move` says of arrays; `back` undoes
        it where there are as many.
        """
        public, excess = (None if x is None else move(x) for x in (self.public, self.excess))
        result = Value(
            self.context,
            self.frac_bits,
            self.bound,
            share=None if public is not None else move(self.share),
            public=public,
            excess=excess,
            settle=lambda: self.settled.moved(move),
            fresh=self.fresh,
            coarse=None if self.coarse is None else lambda: self.shorter.moved(move),
        )
        result._source = self, back if public is None and result.share.size == self.share.size else None
        return result

    # --- precision ---

    @property
    def waits(self) -> bool:
        """Whether a truncation is pending."""
        return self.frac_bits > self.context.protocol.frac_bits

    @property
    def truncatable(self) -> bool:
        """Whether the share itself may be truncated, to the protocol's fractional bits."""
        return self.bound <= self.most(self.frac_bits)

    def most(self, frac_bits: int) -> int:
        """The largest that can be truncated from so many fractional bits to the protocol's."""
        protocol = self.context.protocol
        return bounds.truncatable(protocol, max(frac_bits - protocol.frac_bits, 0))

    @property
    def settled(self) -> "Value":
        """This value with at most the protocol's fractional bits: truncated if it has more. It is truncated
        once, and so is all that was moved out of it, or that a public number was added to.
        """
        if not self.waits:
            return self
        if self._settled is None:
            self._settled = (
                self._settle() if self._settle else self.truncated(self.context.protocol.frac_bits)
            )
        return self._settled

    @property
    def _may_absorb(self) -> bool:
        """Whether an operation may truncate this value by itself, and tell what it truncates to (`_settles`):
        it has not been truncated, nor has what it was moved out of.
        """
        if self._settled is not None or self._told or self._added is not None:
            return False
        if self._source is None:
            return True
        source, back = self._source
        return back is not None and source._may_absorb

    def _settles(self, settle: Callable[[], "Value"]) -> None:
        """This value is truncated to that, and so is what it was moved out of."""
        self._settle, self._told = settle, True
        if self._source is not None:
            source, back = self._source
            assert back is not None
            source._settles(lambda: self.settled.moved(back))

    def truncated(self, frac_bits: int) -> "Value":
        """This value with fewer fractional bits, perhaps fewer than 0."""
        protocol, shift = self.context.protocol, self.frac_bits - frac_bits
        if shift == 0:
            return self
        if self.bound > bounds.truncatable(protocol, shift):
            raise RuntimeError(
                f"a value of {self.bound.bit_length()} bits was about to be truncated by {shift}: that "
                "fails. This is a fault of ciphernav_jax, not yours: please report it with your function."
            )
        variant = truncate.VARIANTS[protocol.truncation]
        share = self._fresh_share() if variant.fresh_shares else self.share
        made = variant.run(self.context.dealer, share, shift)
        result = self._made(frac_bits, -(-self.bound >> shift), made)
        if self.context.witness:
            self.context.witness.truncated(self, shift, result)
        return result

    def _made(self, frac_bits: int, bound: int, made: Masked | Array) -> "Value":
        """What a protocol made of this value."""
        known: dict[str, Any] = {"form" if isinstance(made, Masked) else "share": made}
        return Value(self.context, frac_bits, bound, **known)

    def _fresh_share(self) -> UInt64[Array, "..."]:
        """The share, made uniform where it may not be: one of x - x is the same for each party."""
        return self.share if self.fresh else self.share + self.context.dealer.take(Zero(self.shape))["zero"]

    def lifted(self, frac_bits: int) -> "Value":
        """This value with more fractional bits: shifted left. Local, exact."""
        if frac_bits == self.frac_bits:
            return self
        shift = frac_bits - self.frac_bits
        return Value(
            self.context,
            frac_bits,
            self.bound << shift,
            share=None if self.public is not None else self.share << shift,
            public=None if self.public is None else self.public << shift,
            settle=lambda: self.settled,
        )

    def scaled(self, exponent: int) -> "Value":
        """This value times 2^-exponent: the same shares read with other fractional bits. Local, exact."""
        if self.coarse is not None and exponent > 0:
            return self.shorter.scaled(exponent)
        frac_bits = self.frac_bits + exponent
        if frac_bits < 0:
            return Value(self.context, 0, self.bound << -frac_bits, share=self.share << -frac_bits)
        scaled = Value(self.context, frac_bits, self.bound, share=self.share, fresh=self.fresh)
        if frac_bits <= MAX_FRAC_BITS and (not scaled.waits or scaled.truncatable):
            return scaled
        shorter = self.settled if self.waits else self.truncated(self.frac_bits - 1)
        return shorter.scaled(exponent)

    # --- linear operations, all local ---

    def add(self, other: "Value") -> "Value":
        """The sum. Where one or both wait for a truncation and the sum is too large for one, but not for its
        sign, the sum is kept for comparisons and ReLU, and elsewhere truncated in parts.

        A public number may be of any size. What of it cannot be added to a product is its `excess`: without
        it the sum has the same sign, since the product is smaller, and above 0 the ReLU lacks just it.
        """
        protocol = self.context.protocol
        frac_bits = max(self.frac_bits, other.frac_bits)
        a, b = self.bound_at(frac_bits), other.bound_at(frac_bits)

        def settle() -> Value:
            return self.settled.add(other.settled)

        if frac_bits <= protocol.frac_bits:
            return self._plus(other, frac_bits, None)
        if a + b <= self.most(frac_bits):
            return self._plus(
                other, frac_bits, None if self.public is None and other.public is None else settle
            )
        if frac_bits > 2 * protocol.frac_bits or self.excess is not None or other.excess is not None:
            return settle()
        if a + b <= bounds.SIGNED:
            return self._plus(other, frac_bits, settle)
        if other.public is not None and self.waits and self.truncatable:
            other = other.lifted(protocol.frac_bits)
            assert other.public is not None
            most = 2**62 >> (frac_bits - protocol.frac_bits)
            within = _clipped(other.public, most)
            part = Value(self.context, protocol.frac_bits, most, public=within)
            return self._plus(part, frac_bits, settle, other.public - within)
        if self.public is not None and other.waits and other.truncatable:
            return other.add(self)
        return settle()

    def _plus(
        self,
        other: "Value",
        frac_bits: int,
        settle: Callable[[], "Value"] | None,
        excess: Array | None = None,
    ) -> "Value":
        a, b = self.lifted(frac_bits), other.lifted(frac_bits)
        bound = a.bound + b.bound
        if a.public is not None and b.public is not None:
            return Value(self.context, frac_bits, bound, public=a.public + b.public, settle=settle)
        total = Value(self.context, frac_bits, bound, share=a.share + b.share, settle=settle, excess=excess)
        for secret, number, lifted in ((self, other, b), (other, self, a)):
            if (
                lifted.public is not None
                and secret.waits
                and secret.frac_bits == frac_bits
                and not number.waits
            ):
                base, plus = secret._added or (secret, jnp.uint64(0))
                total._added = base, plus + lifted.public
        return total

    def negated(self) -> "Value":
        return self.moved(jnp.negative, jnp.negative)

    def compared(self, other: "Value") -> "Value":
        """The difference of two values that are compared: of twice the range of those (`range_bits`).

        A product is truncated first where another secret, which is not a product, may be made of what it
        truncates to: x == max(x).
        """
        x, y = self, other
        if x.public is None and y.public is None and x.waits != y.waits:
            x, y = x.settled, y.settled
        difference = x.add(y.negated())
        difference.doubled = True
        return difference

    def beside(self, other: "Value") -> "Value":
        """This value and another of its precision, stacked, to be looked at for their signs."""
        both = Value(
            self.context,
            self.frac_bits,
            max(self.bound, other.bound),
            share=jnp.stack([self.share, other.share]),
        )
        both.doubled = self.doubled
        return both

    def summed(self, count: int, total: Move, axes: tuple[int, ...] | None = None) -> "Value":
        """Sums of up to `count` entries each, as `total` says of arrays; `axes`: over all of those.

        A sum is exact modulo 2^64. Where it may be larger than a result it is only of use once it is scaled
        down, as by a mean. It is then taken again without its last bits: those of sums of as many entries as
        fit are truncated, and then added up.
        """
        x = self
        if self.waits and self.bound * count > self.most(self.frac_bits):
            x = self.settled
        most = bounds.resting(x.context.protocol, x.frac_bits)

        def coarse() -> Value:
            parts, number, add = x, count, total
            if axes is not None:
                parts = x._added_up(axes, max(1, 2**61 // x.bound))
                number, add = parts.shape[0], lambda share: jnp.sum(share, axis=0, dtype=jnp.uint64)
            cut = next(s for s in itertools.count() if -(-parts.bound >> s) * number <= most)
            parts = parts.truncated(x.frac_bits - cut)
            return Value(x.context, parts.frac_bits, parts.bound * number, share=add(parts.share))

        large = x.frac_bits > 0 and not x.waits and x.bound * count > most
        return Value(
            x.context, x.frac_bits, x.bound * count, share=total(x.share), coarse=coarse if large else None
        )

    def _added_up(self, axes: tuple[int, ...], size: int) -> "Value":
        """Sums over axes, of up to `size` entries each: those of the others are along the first axis."""
        share = jnp.moveaxis(self.share, axes, range(len(axes)))
        share = share.reshape(-1, *share.shape[len(axes) :])
        size = min(size, len(share))
        share = jnp.pad(share, [(0, -len(share) % size), *[(0, 0)] * (share.ndim - 1)])
        share = jnp.sum(share.reshape(-1, size, *share.shape[1:]), axis=1, dtype=jnp.uint64)
        return Value(self.context, self.frac_bits, self.bound * size, share=share)

    @cached_property
    def shorter(self) -> "Value":
        """This value, or what is `coarse` of it."""
        return self if self.coarse is None else self.coarse()

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
            sign_bit = min(sign_bit, protocol.range_bits + self.doubled + self.frac_bits)
        return compare.Circuit(self._sign.layout, protocol.adder, sign_bit)

    @property
    def _sign(self) -> compare.Sign:
        return compare.VARIANTS[self.context.protocol.comparison]

    @cached_property
    def positive(self) -> "Value":
        """The bit x > 0, with no fractional bits."""
        return self._made(0, 1, self._sign.run(self.context.dealer, self.share, self._circuit))

    @cached_property
    def relu(self) -> "Value":
        """max(x, 0), truncated on the way where the truncation may be absorbed; keeps the bit x > 0."""
        protocol, dealer = self.context.protocol, self.context.dealer
        shift = max(self.frac_bits - protocol.frac_bits, 0)
        x, plus = self._added or (self, None)
        may_absorb = truncate.VARIANTS[protocol.truncation].absorbed and x._may_absorb
        absorbs = may_absorb and (plus is None or x.truncatable)
        by_opening = self._sign.masked and protocol.multiplication == "beaver"
        if not by_opening or (shift and not absorbs):
            return self.positive.times(self)
        done = relus.relu(dealer, x.share, shift, self._circuit, plus)
        self.positive = Value(self.context, 0, 1, form=done.positive)
        result = Value(self.context, self.frac_bits - shift, -(-self.bound >> shift), share=done.output)

        def settle() -> Value:
            like = partial(Value, self.context, result.frac_bits, -(-x.bound >> shift))
            if x.truncatable:
                return like(form=done.truncated)
            # x is max(x, 0) where the bit says so, and elsewhere what it is below 0.
            above = multiply.bilinear(dealer, done.positive, done.below, ring.TIMES)
            return like(share=done.output + done.below.share() - above)

        if shift:
            x._settles(settle)
        if shift and self.context.witness:
            self.context.witness.truncated(self, shift, result, clipped=True)
        if self.excess is None:
            return result
        above = jnp.where(self.excess >> 63 == 0, self.excess, 0)
        return result.add(Value(self.context, result.frac_bits, bounds.SIGNED, public=above))

    def is_bit(self) -> bool:
        """Whether this is a bit already open under a mask: products with it open nothing more for it."""
        return self.frac_bits == 0 and self.form is not None

    def times(self, other: "Value") -> "Value":
        """The elementwise product, with the fractional bits of both. A bit that is open already is not opened
        again, nor what it selects from.
        """
        if self.context.protocol.multiplication == "ideal" or not (self.is_bit() or other.is_bit()):
            return self.bilinear(other, ring.TIMES)
        bit, value = (self, other.settled) if self.is_bit() else (other, self.settled)
        assert bit.form is not None
        share = multiply.bilinear(self.context.dealer, bit.form, value.form or value.opened, ring.TIMES)
        return value._product(bit, share)

    def bilinear(self, other: "Value", form: Form) -> "Value":
        """A product of any form, with the fractional bits of both."""
        x, y, dealer = self.settled, other.settled, self.context.dealer
        if self.context.protocol.multiplication == "ideal":
            share = ideal.ideal_product(dealer, x.share, y.share, form)
        elif x is y and form is ring.TIMES:
            share = multiply.square(dealer, x.opened)
        else:
            share = multiply.bilinear(dealer, x.opened, y.opened, form)
        return x._product(y, share, form.count(x.shape))

    def _product(self, other: "Value", share: Array, count: int = 1) -> "Value":
        """What has the fractional bits of both, and by the contract is no larger than a product may be."""
        frac_bits = self.frac_bits + other.frac_bits
        most = bounds.product(self.context.protocol, frac_bits)
        bound = min(count * self.bound * other.bound, most)
        return Value(self.context, frac_bits, bound, share=share, fresh=True)


def _clipped(x: UInt64[Array, "..."], most: int) -> UInt64[Array, "..."]:
    """Ring integers within +-most, as signed numbers."""
    signed = lax.bitcast_convert_type(x, jnp.int64)
    return lax.bitcast_convert_type(jnp.clip(signed, -most, most), jnp.uint64)


def align(*values: Value) -> tuple[Value, ...]:
    """The values with equal fractional bits: the most that any has, or the protocol's where that is too many
    for one of them.
    """
    protocol = values[0].context.protocol
    frac_bits = max(v.frac_bits for v in values)
    if frac_bits > protocol.frac_bits:
        largest = max(v.bound_at(frac_bits) for v in values)
        if frac_bits > 2 * protocol.frac_bits or largest > values[0].most(frac_bits):
            values = tuple(v.settled for v in values)
            frac_bits = max(v.frac_bits for v in values)
    return tuple(v.lifted(frac_bits) for v in values)


def join(move: Callable[..., Array], *values: Value) -> Value:
    """Entries of several values beside one another, as `move` says of arrays."""
    aligned = align(*values)
    joined = Value(
        aligned[0].context,
        aligned[0].frac_bits,
        max(v.bound for v in aligned),
        share=move(*[v.share for v in aligned]),
        settle=lambda: join(move, *[v.settled for v in values]),
    )
    joined._told = True  # by its parts
    return joined


def where(condition: Value, on_true: Value, on_false: Value) -> Value:
    """Selection by a secret bit: on_false + condition (on_true - on_false)."""
    on_true, on_false = on_true.settled, on_false.settled
    return condition.times(on_true.add(on_false.negated())).add(on_false)
