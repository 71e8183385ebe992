"""The operations of random programs in float64, and how far off each entry of a secret evaluation may be.

The bounds are derived from what the documentation promises:

- a product or a contraction is truncated once: an error of one unit of the last place (P units for
  "wrap-count"), beside what the errors of its factors make of it;
- a constant has a relative error of 2^-f in each entry, or of half a unit in the product where that is
  more, and takes one truncation, three where it multiplies a large sum, and up to 6 where it is of several
  magnitudes, 10 where both; a public number of the run an absolute error of 2^-(2f + 1), and two truncations;
- in a contraction with a constant, an error of 2^-(f + 1) for each term, or of half a unit in all;
- sums, moves, maxima and selections add nothing;
- comparisons are exact unless the difference lies within the error of what is compared; then any answer is
  right, and what depends on it may be either.

`Reference` raises `Outside` where a step leaves the range that is promised: values within 2^(61 - f),
products within 2^(62 - 2 f), what is compared within 2^range_bits. Such a step is not taken, so that every
program must come out right.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import ciphernav_jax as cn
from ciphernav_jax.protocols.truncate import VARIANTS

from .operations import BODIES

FLOAT_ERROR = 2.0**-50  # of float64 itself, generously


class Outside(Exception):
    """A step leaves the promised range, or nothing would be known of its result."""


@dataclass(frozen=True)
class Bounded:
    """Entries with bounds of their errors.

    Attributes:
        value: float64, an integer type, or bool.
        error: float64 of the same shape, absolute.
        dtype: as JAX has it: float32 where the value has float64.
        secret: otherwise public.
        count: how many entries have been added up in one, at most.
    """

    value: np.ndarray
    error: np.ndarray
    dtype: np.dtype
    secret: bool = True
    count: float = 1.0

    @property
    def shape(self) -> tuple[int, ...]:
        return self.value.shape

    @property
    def kind(self) -> str:
        return {"f": "float", "b": "bool"}.get(self.dtype.kind, "int")

    def moved(self, move: Callable[[np.ndarray], np.ndarray]) -> "Bounded":
        return replace(self, value=np.asarray(move(self.value)), error=np.asarray(move(self.error)))


def _exactly(total: Callable[..., Any], x: Bounded, **how: Any) -> np.ndarray:
    """Sums of multiples of the resolution, where float64 would round after each of a million entries."""
    if x.kind != "float":
        return total(x.value, **how)
    return np.asarray(total(x.value.astype(np.longdouble), **how), np.float64)


class Reference:
    """The same operations on `Bounded` arrays; see the head of this module."""

    def __init__(self, protocol: cn.Protocol, parties: int):
        f = protocol.frac_bits
        self.f, self.unit = f, 2.0**-f
        variant = VARIANTS[protocol.truncation]
        self.truncation = self.unit * (parties if variant.of_each_party else 1)
        self.most, self.product_bound = 2.0 ** (61 - f), 2.0 ** (62 - 2 * f)
        if variant.fails:
            # They fail with probability |x| / 2^64: here below 2^-18.
            self.most = self.product_bound = 2.0 ** (46 - 2 * f)
        self.compared = min(self.most, 2.0 ** (protocol.range_bits or 64))

    # --- checks ---

    def _made(self, value, error, dtype, *, within: float | None = None, count: float = 1.0) -> Bounded:
        value, error = np.asarray(value), np.asarray(error, np.float64)
        if np.dtype(dtype).kind == "f":
            value = np.asarray(value, np.float64)
            # An exact sum of exact values is exact in float64 too, up to 2^53 units. A product has more bits
            # than its unit, and is rounded: see v - (v + c).
            rounding = np.where(error > 0, 2.0**-53, 0)
            rounding = np.where(np.abs(value) < 2.0**52 * self.unit, rounding, FLOAT_ERROR)
            error = error + np.abs(value) * rounding
            if not np.all(np.abs(value) + error <= (within or self.most)):
                raise Outside
        return Bounded(value, np.broadcast_to(error, value.shape), np.dtype(dtype), count=count)

    def _product(self, value, error, dtype) -> Bounded:
        return self._made(
            value, error + self.truncation + np.abs(value) * FLOAT_ERROR, dtype, within=self.product_bound
        )

    def _comparable(self, *operands: Bounded) -> None:
        for x in operands:
            most = self.compared if x.kind == "float" else 2**61
            if not np.all(np.abs(np.asarray(x.value, np.float64)) + x.error <= most):
                raise Outside

    def _exact(self, x: Bounded) -> np.ndarray:
        if np.any(x.error):
            raise Outside
        return x.value

    def constant(self, x: Bounded, c) -> Bounded:
        value = np.asarray(np.asarray(c, x.dtype), np.float64 if x.kind == "float" else x.dtype)
        return Bounded(value, np.zeros(value.shape), x.dtype, secret=False)

    def _encoded(self, x: Bounded) -> Bounded:
        """A public operand as it is rounded to the resolution."""
        if x.secret or x.kind != "float":
            return x
        return replace(x, error=np.abs(np.round(x.value / self.unit) * self.unit - x.value))

    # --- arithmetic ---

    def add(self, x, y):
        x, y = self._encoded(x), self._encoded(y)
        return self._made(
            x.value + y.value, self._wrapping(x, y, x.error + y.error), x.dtype, count=max(x.count, y.count)
        )

    def sub(self, x, y):
        x, y = self._encoded(x), self._encoded(y)
        return self._made(
            x.value - y.value, self._wrapping(x, y, x.error + y.error), x.dtype, count=max(x.count, y.count)
        )

    def _wrapping(self, x, y, error):
        """An integer that is not known for sure must not wrap."""
        if x.kind == "int" and np.any(error) and np.iinfo(x.dtype).bits < 64:
            raise Outside
        return error

    def neg(self, x):
        return self._made(-x.value, self._wrapping(x, x, x.error), x.dtype, count=x.count)

    def mul(self, x, y):
        if x.kind == "int":
            return self._made(x.value * y.value, self._exact(x) * 0.0 + self._exact(y) * 0.0, x.dtype)
        error = np.abs(x.value) * y.error + np.abs(y.value) * x.error + x.error * y.error
        for secret, public in ((x, y), (y, x)):
            if not public.secret:  # a number of the run
                error = error + np.abs(secret.value) * self.unit**2 / 2 + self.truncation
        return self._product(x.value * y.value, error, x.dtype)

    def square(self, x):
        return self.mul(x, x)

    def power(self, x, n):
        if n == 1:
            return x
        square = self.power(self.mul(x, x), n // 2)
        return self.mul(square, x) if n % 2 else square

    def dot(self, x, y):
        if x.kind == "bool":
            return Bounded(x.value @ y.value, self._exact(x) @ self._exact(y) * 0.0, x.dtype)
        if x.kind == "int":
            return self._made(x.value @ y.value, (self._exact(x) @ self._exact(y)) * 0.0, x.dtype)
        a, b = np.abs(x.value), np.abs(y.value)
        return self._product(
            x.value @ y.value, a @ y.error + x.error @ b + x.error @ y.error + a @ b * FLOAT_ERROR, x.dtype
        )

    def plus(self, x, c):
        return self.add(x, self.constant(x, c))

    def scaled(self, x, c, mixed=False):
        c = self.constant(x, c).value
        value = x.value * c
        error = np.abs(c) * x.error + np.maximum(np.abs(value) * self.unit, self.unit / 2)
        mixed, large = mixed or c.size > 1, x.count > 1
        limbs = 10 - self.f // 4  # as `scaling._times_float` says
        truncations = (limbs + 4 if mixed else 3) if large else limbs if mixed else 1
        return self._made(value, error + truncations * self.truncation, x.dtype, count=x.count)

    def divided(self, x, c, mixed=False):
        return self.scaled(x, 1.0 / self.constant(x, c).value, mixed)

    def forgotten(self, x, c):
        return self.plus(self.scaled(x, 0.0), c)

    def over(self, x, y):
        if np.any(np.abs(y.value) < 1e-6):
            raise Outside
        return self.mul(x, replace(y, value=1.0 / y.value))

    def table(self, x, c):
        c = self.constant(x, c).value
        each = np.sum(np.abs(x.value), axis=-1, keepdims=True) * self.unit / 2
        error = x.error @ np.abs(c) + each + self.unit / 2
        return self._made(x.value @ c, error + self.truncation, x.dtype, within=self.product_bound)

    def multiple(self, x, n):
        if x.kind == "float":
            return self._made(
                x.value * n, x.error * abs(n) + np.abs(x.value * n) * FLOAT_ERROR, x.dtype, count=x.count
            )
        return self._made(x.value * np.asarray(n, x.dtype), self._exact(x) * 0.0, x.dtype)

    # --- comparisons and selections ---

    def compare(self, x, y, name):
        x, y = self._encoded(x), self._encoded(y)
        self._comparable(x, y)
        error = x.error + y.error
        with np.errstate(over="ignore"):
            apart = np.abs(np.asarray(x.value, np.float64) - np.asarray(y.value, np.float64))
        unsure = (error > 0) & (apart <= error)
        return Bounded(getattr(np, name)(x.value, y.value), unsure * 1.0, np.dtype(bool))

    def against(self, x, c, name):
        return self.compare(x, self.constant(x, c), name)

    def maximum(self, x, y):
        return self._extreme(np.maximum, x, y)

    def minimum(self, x, y):
        return self._extreme(np.minimum, x, y)

    def _extreme(self, of_two, x, y):
        x, y = self._encoded(x), self._encoded(y)
        self._comparable(x, y)
        return self._made(of_two(x.value, y.value), np.maximum(x.error, y.error), x.dtype)

    def relu(self, x):
        return self.maximum(x, self.constant(x, 0))

    def clip(self, x, low, high):
        return self.minimum(self.maximum(x, self.constant(x, low)), self.constant(x, high))

    def abs(self, x):
        self._comparable(x)
        return self._made(np.abs(x.value), x.error, x.dtype)

    def sign(self, x):
        self._comparable(x)
        unsure = (x.error > 0) & (np.abs(np.asarray(x.value, np.float64)) <= x.error)
        return self._made(np.sign(x.value), unsure * 2.0, x.dtype)

    def where(self, b, x, y):
        x, y = self._encoded(x), self._encoded(y)
        error = np.where(b.value, x.error, y.error)
        either = np.abs(np.asarray(x.value, np.float64) - y.value) + x.error + y.error
        return self._made(np.where(b.value, x.value, y.value), np.where(b.error > 0, either, error), x.dtype)

    def one_of(self, b, x, on_true, on_false):
        return self.where(b, self.scaled(x, on_true, True), self.scaled(x, on_false, True))

    def over_one_of(self, b, x, on_true, on_false):
        return self.where(b, self.divided(x, on_true, True), self.divided(x, on_false, True))

    # --- reductions ---

    def sum(self, x, axis):
        value = _exactly(np.sum, x, axis=axis)
        count = x.count * x.value.size / max(np.asarray(value).size, 1)
        fuzz = (
            np.sum(np.abs(x.value), axis=axis) * FLOAT_ERROR if x.kind == "float" and np.any(x.error) else 0.0
        )
        return self._made(
            value,
            np.sum(x.error, axis=axis) + fuzz,
            np.asarray(value).dtype if x.kind != "float" else x.dtype,
            count=count,
        )

    def mean(self, x, axis):
        total = self.sum(x, axis)
        return self.scaled(total, total.value.size / x.value.size)

    def var(self, x, axis):
        mean = self.mean(x, axis).moved(lambda v: np.expand_dims(v, () if axis is None else axis))
        return self.mean(self.square(self.sub(x, mean)), axis)

    def cumsum(self, x):
        value = _exactly(np.cumsum, x, axis=0, dtype=None if x.kind == "float" else x.value.dtype)
        return self._made(
            value, self._wrapping(x, x, np.cumsum(x.error, axis=0)), x.dtype, count=x.count * len(x.value)
        )

    def max(self, x, axis):
        self._comparable(x)
        return self._made(np.max(x.value, axis=axis), np.max(x.error, axis=axis), x.dtype)

    def min(self, x, axis):
        self._comparable(x)
        return self._made(np.min(x.value, axis=axis), np.max(x.error, axis=axis), x.dtype)

    def argmax(self, x, axis):
        self._comparable(x)
        index = np.argmax(x.value, axis=axis)
        largest = np.max(x.value, axis=axis, keepdims=True)
        error = 2 * np.max(x.error, axis=axis, keepdims=True)
        near = np.sum(np.asarray(largest, np.float64) - x.value <= error, axis=axis)
        unsure = (near > 1) & (np.squeeze(error, axis) > 0)
        return Bounded(index, unsure * float(x.shape[axis]), np.dtype(np.int64))

    def argmin(self, x, axis):
        if x.kind != "float":
            raise Outside
        return self.argmax(self.neg(x), axis)

    def masked_max(self, x, hidden, mask):
        if self.compared < self.most:
            raise Outside  # a mask is refused with `range_bits`
        shown = replace(
            x, value=np.where(hidden, -self.compared, x.value), error=np.where(hidden, 0, x.error)
        )
        return replace(self.max(shown, -1), count=2.0)  # its bound is the mask's: scaled, it is a large sum

    # --- types and logic ---

    def convert(self, x, dtype):
        dtype = np.dtype(dtype)
        if dtype.kind == "b":
            return self.compare(x, self.constant(x, 0), "not_equal")
        if dtype.kind != "f":
            if np.any(x.error) and x.kind != "bool":
                raise Outside
            return Bounded(x.value.astype(dtype), x.error, dtype)
        return self._made(x.value.astype(np.float64), x.error, dtype, within=self.product_bound)

    def logic(self, x, y, name):
        error = np.maximum(x.error, y.error)
        return Bounded(getattr(np, name)(x.value, y.value), np.asarray(error), np.dtype(bool))

    def logical_not(self, x):
        return Bounded(~x.value, x.error, x.dtype)

    def any(self, x, axis):
        return Bounded(np.any(x.value, axis=axis), np.max(x.error, axis=axis), x.dtype)

    def all(self, x, axis):
        return Bounded(np.all(x.value, axis=axis), np.max(x.error, axis=axis), x.dtype)

    # --- moves ---

    def reshape(self, x, shape):
        return x.moved(lambda v: v.reshape(shape))

    def transpose(self, x):
        return x.moved(np.transpose)

    def reverse(self, x):
        return x.moved(lambda v: np.flip(v, 0))

    def part(self, x, start):
        return x.moved(lambda v: v[start:])

    def copies(self, x, n):
        return x.moved(lambda v: np.broadcast_to(v, (n, *v.shape)))

    def padded(self, x, c):
        ends = self._encoded(self.constant(x, c)).moved(lambda v: np.broadcast_to(v, (1, *x.shape[1:])))
        return self.joined(self.joined(ends, x), ends)

    def joined(self, x, y):
        value, error = (np.concatenate(pair) for pair in ((x.value, y.value), (x.error, y.error)))
        return Bounded(value, error, x.dtype, count=max(x.count, y.count))

    def split(self, x):
        return x.moved(lambda v: np.split(v, 2)[1])

    def take(self, x, index):
        return x.moved(lambda v: v[np.array(index)])

    def filled(self, x, c):
        fill = self._encoded(self.constant(x, c)).moved(lambda v: np.broadcast_to(v, (1, *x.shape[1:])))
        return self.joined(self.part(x, 0).moved(lambda v: v[:1]), fill)

    def put(self, x, y):
        y = self._encoded(y)
        return self.joined(y.moved(lambda v: np.broadcast_to(v, (1, *x.shape[1:]))), x.moved(lambda v: v[1:]))

    def put_sum(self, x, y):
        first, total = x.moved(lambda v: v[0]), self.sum(y, 0)
        total = replace(total, value=total.value.astype(x.value.dtype), dtype=x.dtype)  # numpy's is int64
        return self.put(x, self.add(first, total))

    def slice_at(self, x, i):
        return x.moved(lambda v: v[min(int(i.value), len(v) - 1)])  # as JAX: the last where there is none

    def update_at(self, x, y, i):
        def put(v, w):
            v = v.copy()
            v[min(int(i.value), len(v) - 1)] = w
            return v

        y = self._encoded(y)
        return self._made(put(x.value, y.value), put(x.error, y.error), x.dtype)

    # --- loops and branches ---

    def scan(self, x, start, body):
        carries = []
        for i in range(x.shape[0]):
            start = BODIES[body](self, start, x.moved(lambda v, i=i: v[i]))
            carries.append(start)
        value, error = (np.stack(v) for v in zip(*((c.value, c.error) for c in carries), strict=True))
        return self._made(value, error + self.truncation, x.dtype)

    def repeated(self, x, n, body):
        carry = x
        for _ in range(n):
            carry = BODIES[body](self, carry, x)
        return replace(carry, error=carry.error + self.truncation)

    def until(self, x, n, body):
        return self.repeated(x, int(n.value), body)

    def branch(self, x, flag, body, other):
        return BODIES[body if flag.value else other](self, x, x)

    def slope(self, x, c):
        limit = self.constant(x, c)
        above, equal = self.compare(x, limit, "greater"), self.compare(x, limit, "equal")
        largest = self.maximum(x, limit)
        self.square(largest)  # it is within the range of products
        none = self.constant(x, np.zeros(x.shape))
        half = self.where(equal, largest, none)
        found = self.where(above, self.scaled(largest, 2.0), half)
        return replace(found, error=found.error + self.truncation)  # of what is multiplied by the bits

    def product_slope(self, x, y, c):
        limit, product = self.constant(x, c), self.mul(x, y)
        y = replace(y, value=np.broadcast_to(y.value, x.shape), error=np.broadcast_to(y.error, x.shape))
        above, equal = self.compare(product, limit, "greater"), self.compare(product, limit, "equal")
        half = self.where(equal, self.scaled(y, 0.5), self.constant(x, np.zeros(x.shape)))
        found = self.where(above, y, half)
        rounded = 0 if y.secret else np.abs(y.value) * self.unit**2 + self.unit
        return replace(found, error=found.error + rounded + self.truncation)

    def product_beside_its_maximum(self, x, y, z, name):
        product = self.mul(x, y)
        self.maximum(product, z)  # it is within range
        above = self.compare(z, product, "greater")
        known = {"less": False, "greater_equal": True}
        value = {
            "greater": above.value,
            "not_equal": above.value,
            "less_equal": ~above.value,
            "equal": ~above.value,
        }.get(name, np.full(product.shape, known.get(name)))
        return replace(above, value=value, error=above.error * (name not in known))

    def largest_product(self, x, y):
        product = self.mul(x, y)
        largest = self.max(product, None)
        chosen = self.compare(product, largest, "equal")
        return self.where(chosen, product, self.constant(x, np.zeros(())))
