"""Products of a secret with public numbers: constants of the function, and numbers that only the run knows.

A public number is encoded with as many bits as the secret's bound leaves room for. A constant of several
magnitudes, and most floats that only the run knows, take several limbs, each holding what the one before left
over; each product is truncated by itself, all in one round.
"""

import itertools
import math
from collections.abc import Iterator
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from ciphernav_jax import ring
from ciphernav_jax.parties.party import AXIS
from ciphernav_jax.ring.linear import DimensionNumbers
from ciphernav_jax.secret import bounds
from ciphernav_jax.secret.findings import NotUsable
from ciphernav_jax.secret.value import MAX_FRAC_BITS, Context, Value

Public = Array | np.ndarray


def is_float(x: Public) -> bool:
    return jnp.issubdtype(x.dtype, np.floating)


def largest(x: np.ndarray) -> int:
    """The largest magnitude of an array of integers."""
    return max(abs(int(x.min())), abs(int(x.max()))) if x.size else 0


def _refuse(context: Context, x: Public, bad: Any, of_constant: str, of_run: str) -> None:
    """Raises NotUsable where a constant is bad; of a number that only the run knows it is found."""
    if not isinstance(x, np.ndarray):
        context.find(of_run, bad)
    elif np.any(bad):
        raise NotUsable(of_constant)


def without_nan(context: Context, x: Public) -> Public:
    """A public float in float64, which is no NaN.

    Raises:
        NotUsable: a constant is NaN. (A number that only the run knows becomes 0; it is found.)
    """
    numpy: Any = np if isinstance(x, np.ndarray) else jnp
    x = x.astype(np.float64)
    missing = numpy.isnan(x)
    _refuse(
        context,
        x,
        missing,
        "a constant is NaN, which no secret can be",
        "a public number that meets a secret is NaN",
    )
    return numpy.where(missing, 0.0, x)


def from_public(context: Context, x: Public, most: int = bounds.MASK) -> Value:
    """A public array as a value: floats at the protocol's fractional bits, integers and bools exactly.

    A float whose ring integer is larger than `most` becomes that: an infinity, or another mask.

    Raises:
        NotUsable: a constant is NaN, or an integer beyond 2^62; with `range_bits` a mask, or compared and
            not within them. (Of a number that only the run knows it is found.)
    """
    if not is_float(x):
        too_large = "a public integer that meets a secret is larger than 2^62, up to which they are compared"
        fits = ring.fits(x, 2**62 + 1)
        if fits is not True:
            _refuse(context, x, ~fits, f"{too_large}. As a mask -2**62 loses every maximum", too_large)
        bound = largest(x) if isinstance(x, np.ndarray) else bounds.shared(context.protocol, x.dtype)
        return Value(context, 0, bound, public=ring.encode(x, 0))
    _require_in_range_bits(context, x, most)
    frac_bits = context.protocol.frac_bits
    numpy: Any = np if isinstance(x, np.ndarray) else jnp
    limit = most / 2**frac_bits
    x = numpy.asarray(numpy.clip(without_nan(context, x), -limit, limit))  # of a scalar too: still a constant
    bound = largest(np.round(x * 2**frac_bits)) if isinstance(x, np.ndarray) else most
    return Value(context, frac_bits, bound, public=ring.encode(x, frac_bits))


def _require_in_range_bits(context: Context, x: Public, most: int) -> None:
    protocol = context.protocol
    if protocol.range_bits is None:
        return
    limit = 2.0**protocol.range_bits if most == bounds.COMPARED else protocol.bound
    said = (
        f"meets a secret, and range_bits={protocol.range_bits} says that what is compared stays below "
        f"{2**protocol.range_bits}: use range_bits=None with masks"
    )
    beyond = abs(x) > limit
    constant = (
        f"a constant of {x[beyond].flat[0]:g} {said}" if isinstance(x, np.ndarray) and np.any(beyond) else ""
    )
    _refuse(context, x, beyond, constant, f"a public number beyond {limit:g} {said}")


def reciprocal(context: Context, x: Public) -> Public:
    """1 / x in float64.

    Raises:
        NotUsable: a constant is 0 or NaN. (Of a number that only the run knows it is found.)
    """
    x = x.astype(np.float64)
    _refuse(context, x, x == 0, "a secret is divided by 0", "a public number that divides a secret is 0")
    # Of a scalar too: still a constant.
    return np.asarray(1.0 / x) if isinstance(x, np.ndarray) else 1.0 / x


def _encoded(context: Context, public: Array, frac_bits: int) -> Array:
    """A factor that only the run knows, with so many fractional bits. What is not usable becomes 0; it is
    found.
    """
    limit = 2.0 ** (62 - frac_bits)
    usable = ring.fits(public, limit)
    context.find(
        f"a public number that multiplies a secret is not finite, or not below {limit:g} in magnitude",
        ~jnp.asarray(usable),
    )
    return ring.encode(jnp.where(usable, public, 0), frac_bits)


def _sum(values: list[Value]) -> Value:
    """Of values that wait for their truncations: one alone as it is, several truncated in one round."""
    total = values[0]
    for value in values[1:]:
        total = total.settled.add(value.settled)
    return total


def _useful_bits(x: Value, count: int = 1) -> int:
    """How many fractional bits of a factor move a sum of `count` products with x by half a unit."""
    return x.context.protocol.frac_bits - x.frac_bits + (x.bound * count - 1).bit_length()


# --- constants --------------------------------------------------------------------------------------


def _require_finite(constant: np.ndarray) -> None:
    if not np.all(np.isfinite(constant)):
        raise NotUsable("a secret is multiplied by a constant that is not finite (NaN or infinity)")


def dyadic(constant: np.ndarray) -> tuple[np.ndarray, int] | None:
    """The constant as m 2^-e with integers m (int64) and the smallest such e, exactly; None where the
    integers would have more than 62 bits.
    """
    if not np.issubdtype(constant.dtype, np.floating):
        return constant.astype(np.int64), 0
    constant = constant.astype(np.float64)
    used = constant[constant != 0]
    if not used.size:
        return np.zeros(constant.shape, np.int64), 0
    mantissa, exponent = np.frexp(used)
    digits = np.ldexp(mantissa, 53).astype(np.int64)
    trailing_zeros = np.log2(digits & -digits).astype(np.int64)
    e = int(np.max(53 - exponent - trailing_zeros))
    if np.max(exponent) + e > 62:
        return None
    return np.asarray(np.ldexp(constant, e).astype(np.int64)), e


def _limbs(constant: np.ndarray, e: int, bits: int, finest: int) -> Iterator[tuple[np.ndarray, int]]:
    """Integers m (int64) and exponents e, of which the first is given, so that the sum of all m 2^-e is the
    constant: each entry to 2^-bits of itself, or to 2^-(finest + 1).
    """
    rest = constant
    while True:
        m = np.round(np.ldexp(rest, e))
        yield np.asarray(m.astype(np.int64)), e
        rest = rest - np.ldexp(m, -e)
        if e >= finest or np.all(np.abs(rest) <= np.ldexp(np.abs(constant), -bits)):
            return
        e = min(e + bits, finest)


def times_constant(x: Value, constant: np.ndarray) -> Value:
    """A secret times a public constant, with broadcasting. Local, but for truncations.

    Integers and powers of two multiply exactly. Other entries are right to 2^-f of themselves, or to what
    moves the result by half a unit. One truncation is left pending; where the entries differ in magnitude, or
    x is a large sum, several have been carried out.

    Raises:
        NotUsable: an entry is NaN or infinite.
    """
    constant = np.asarray(constant)
    _require_finite(constant)
    exact = dyadic(constant)
    if exact is None or exact[1] > 0:
        x = x.shorter
    if exact is not None and (exact[1] <= _useful_bits(x) or largest(exact[0]) == 1):
        product = _times_integers(x, *exact)
        if product is not None:
            return product
    if x.waits:
        return times_constant(x.settled, constant)
    return _times_float(x, constant.astype(np.float64))


def _times_integers(x: Value, m: np.ndarray, e: int) -> Value | None:
    """x m 2^-e, exactly; None where that could not be truncated."""
    frac_bits, protocol = x.frac_bits + e, x.context.protocol
    bound = x.bound * largest(m)
    waits = max(frac_bits, x.frac_bits) > protocol.frac_bits
    if waits and (frac_bits > MAX_FRAC_BITS or bound > x.most(frac_bits)):
        return None
    if m.size and np.all(m == m.flat[0]) and m.flat[0] in (1, -1):
        shape = np.broadcast_shapes(x.shape, m.shape)
        x = x if shape == x.shape else x.moved(lambda share: jnp.broadcast_to(share, shape))
        return (x if m.flat[0] == 1 else x.negated()).scaled(e)
    share = x.share * m.view(np.uint64)
    if frac_bits < 0:
        return Value(x.context, x.frac_bits, bound, share=share).scaled(e)
    return Value(x.context, frac_bits, bound, share=share)


def _times_float(x: Value, constant: np.ndarray) -> Value:
    """A value at rest times what is not exact in a few bits.

    Entries up to 2^k take one limb, and one for each f bits of k + 62 - 2f: at most 5 truncations with 20
    fractional bits (4 with 24, 6 with 16). A value beyond 2^(62 - f), as a masked maximum is, takes one more
    for its first bits, and the limbs of the others: at most 10 from 16 fractional bits on.
    """
    protocol, most = x.context.protocol, np.max(np.abs(constant), initial=0.0)
    room = 62 - protocol.frac_bits
    cut = next(s for s in itertools.count() if -(-x.bound >> s) < 2**room)
    if not cut:
        return _times_limbs(x, constant)[0]
    # No room for the constant's bits: the first bits of x by themselves.
    high = x.truncated(x.frac_bits - cut)
    product, encoded = _times_limbs(high, constant)
    if most * 2.0 ** (cut + protocol.frac_bits - x.frac_bits) <= 1:
        return product  # the others are below the resolution of the result
    # By the same factor, of which the error else counts as often as there is something to cancel.
    rest = x.add(high.lifted(x.frac_bits).negated())
    low = Value(x.context, x.frac_bits, lax.axis_size(AXIS) << cut, share=rest.share)
    return _sum([product, _times_limbs(low, encoded)[0]])


def _times_limbs(x: Value, constant: np.ndarray) -> tuple[Value, np.ndarray]:
    """A value with room for a constant's bits times it, and the constant as it is encoded."""
    most = np.max(np.abs(constant), initial=0.0)
    bits, finest = min(62 - x.bound.bit_length(), 53), _useful_bits(x)
    first = min(bits - int(np.ceil(np.log2(most))), finest) if most else finest
    if x.bound * int(np.round(np.ldexp(most, first))) > x.most(x.frac_bits + first):
        first -= 1
    products, encoded = [], np.zeros(constant.shape)
    for m, e in _limbs(constant, first, bits, finest):
        if np.any(m) or not products:
            product = _times_integers(x, m, e)
            assert product is not None
            products.append(product)
            encoded = encoded + np.ldexp(m, -e)
    return _sum(products), encoded


# --- numbers that only the run knows ----------------------------------------------------------------


def times_public(context: Context, x: Value, public: Array) -> Value:
    """A secret times a public array that only the run knows, with broadcasting. Local, but for truncations.

    Integers and bools multiply exactly. A float is encoded in two limbs, to 2^-(2f + 1), so that the product
    errs by at most 2 + |x| 2^-(f + 1) units, |x| being at most 2^(62 - 2f): two truncations have been carried
    out. Of a secret bit one limb is enough, and none is needed.
    """
    protocol = x.context.protocol
    if not is_float(public):
        bound = x.bound * bounds.shared(protocol, public.dtype)
        if x.waits and bound > x.most(x.frac_bits):
            return times_public(context, x.settled, public)
        return Value(x.context, x.frac_bits, bound, share=x.share * ring.encode(public, 0))
    x = x.settled.shorter

    def times_limb(x: Value, limb: Array, e: int, largest: int) -> Value:
        frac_bits = x.frac_bits + e
        bound = min(x.bound * largest, bounds.product(protocol, frac_bits))
        return Value(x.context, frac_bits, bound, share=x.share * limb)

    finest, e = _useful_bits(x), 2 * protocol.frac_bits - x.frac_bits
    if finest <= e:
        return times_limb(x, _encoded(context, public, finest), finest, bounds.SIGNED)
    first = _encoded(context, public, e)
    product = times_limb(x, first, e, bounds.SIGNED)
    rest = public.astype(jnp.float64) - ring.decode(first, e)
    # It is at most 2^-(e + 1): of a large x the last bits do not matter.
    cut = max(0, x.bound.bit_length() + protocol.frac_bits - 62)
    low, finest = x.truncated(x.frac_bits - cut), min(e + protocol.frac_bits, finest)
    return _sum([product, times_limb(low, ring.encode(rest, finest), finest, 2 ** (finest - e - 1))])


# --- contractions -----------------------------------------------------------------------------------


def dot_public(
    context: Context,
    x: Value,
    public: Public,
    dimension_numbers: DimensionNumbers,
    *,
    public_left: bool,
) -> Value:
    """The tensor product of a secret and a public array. Local; the truncation is left pending.

    Integers multiply exactly. A float is encoded to 2^-f as if it were shared; to 2^-2f where x is an
    integer; a constant to what moves the result by half a unit, where its size leaves room for that.
    """
    x, protocol = x.settled, x.context.protocol
    axes = dimension_numbers[0][0 if public_left else 1]
    e = 2 * protocol.frac_bits - x.frac_bits if is_float(public) else 0
    reach = bounds.SIGNED
    if isinstance(public, np.ndarray):
        e, encoded = _encoded_factor(x, public, axes, e)
        # Floats add up without wrapping around, with a little more to be sure.
        reach = 1 + int(1.000001 * np.max(np.sum(np.abs(encoded.astype(np.float64)), axis=axes), initial=0.0))
        encoded = encoded.view(np.uint64)
    else:
        encoded = _encoded(context, public, e) if is_float(public) else ring.encode(public, 0)
    left, right = (encoded, x.share) if public_left else (x.share, encoded)
    share = ring.dot_general(jnp.asarray(left), jnp.asarray(right), dimension_numbers)
    bound = min(x.bound * reach, bounds.product(protocol, x.frac_bits + e))
    return Value(x.context, x.frac_bits + e, bound, share=share)


def _encoded_factor(
    x: Value, constant: np.ndarray, axes: tuple[int, ...], usual: int
) -> tuple[int, np.ndarray]:
    """The fractional bits at which a constant factor of a contraction over `axes` is encoded, and so it is
    as integers (int64).
    """
    _require_finite(constant)
    exact = dyadic(constant)
    if exact is not None and exact[1] <= usual:
        m, e = exact
        return max(e, 0), m << max(-e, 0)
    constant = constant.astype(np.float64)
    reach = np.max(np.sum(np.abs(constant), axis=axes), initial=0.0)
    fits = 61 - int(np.ceil(np.log2(reach))) - x.bound.bit_length()
    useful = _useful_bits(x, math.prod(constant.shape[axis] for axis in axes))
    e = min(max(fits, usual), useful)
    if reach * 2.0**e >= 2.0**62:
        raise NotUsable(
            f"a secret is multiplied by a constant of size {reach:g}: products of "
            f"{x.context.protocol} stay below {x.context.protocol.bound:g}: scale the constant down"
        )
    return e, np.asarray(np.round(np.ldexp(constant, e)).astype(np.int64))
