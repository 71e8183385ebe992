"""Programs at random: every operation, shapes, types, magnitudes from one unit to the ends of the range."""

from collections.abc import Callable
from typing import Any

import numpy as np

from .operations import BODIES
from .program import Program, Step
from .reference import Bounded, Outside, Reference

SHAPES = [(), (3,), (4,), (2, 3)]
NAMES = ["greater", "less", "greater_equal", "less_equal", "equal", "not_equal"]
INTEGERS = [np.int8, np.uint8, np.int16, np.uint16, np.int32, np.uint32, np.int64]


class Draw:
    """Random choices for one program."""

    def __init__(self, seed: tuple[int, ...], reference: Reference, widest: int):
        self.rng = np.random.default_rng(seed)
        self.reference = reference
        self.widest = widest
        self.float = np.dtype(str(self.rng.choice(["float64", "float64", "float64", "float32"])))

    def coin(self, probability: float) -> bool:
        return bool(self.rng.random() < probability)

    def one(self, options):
        return options[self.rng.integers(len(options))]

    # --- numbers ---

    def magnitude(self, low: float, high: float) -> float:
        """Log-uniform, often at an end."""
        if self.coin(0.15):
            return high
        return float(2.0 ** self.rng.uniform(np.log2(low), np.log2(high)))

    def constant(self, shape=()):
        """Of any magnitude; mixed, with zeros, of one value, an integer, or a power of two."""

        def one():
            kind = self.rng.integers(8)
            sign = self.one([1.0, 1.0, -1.0])
            if kind == 0:
                return sign * float(self.rng.integers(0, 8))
            if kind == 1:
                return sign * 2.0 ** int(self.rng.integers(-12, 12))
            if kind == 2:
                return sign * float(self.rng.integers(1, 4_000_000))
            return sign * self.magnitude(1e-7, 1e6)

        if not shape:
            return one()
        values = [one() for _ in range(int(np.prod(shape)))]
        if self.coin(0.3):
            values = [v if self.coin(0.5) else 0.0 for v in values]
        return np.reshape(values, shape)

    def values(self, shape, dtype, most: float):
        """Secrets over the whole range: multiples of the resolution, with zeros, ties, and both ends."""
        dtype = np.dtype(dtype)
        size = int(np.prod(shape))
        if dtype.kind == "b":
            return np.reshape(self.rng.integers(2, size=size) == 1, shape)
        if dtype.kind in "iu":
            info = np.iinfo(dtype)
            bits = min(info.bits, 40) if self.coin(0.7) else min(info.bits, 61)
            bits = int(self.rng.integers(1, bits + 1))
            low, high = max(info.min, -(2 ** (bits - 1))), min(info.max, 2**bits - 1, 2**61)
            v = self.rng.integers(low, high, size=size, endpoint=True)
            return np.reshape(v.astype(dtype), shape)
        unit = self.reference.unit
        top = max(most - unit if self.coin(0.4) else self.magnitude(unit, max(most - unit, 2 * unit)), unit)
        v = np.array(
            [
                top * self.one([1.0, -1.0, 1.0, self.rng.uniform(-1, 1), self.rng.uniform(-1, 1)])
                for _ in range(size)
            ]
        )
        if self.coin(0.3):
            v = np.full(size, v[0] if size else 0.0)
        if self.coin(0.2):
            v = np.where(self.rng.random(size) < 0.5, v, 0.0)
        v = np.round(v / unit) * unit
        if dtype == np.float32:  # its multiples of the resolution, within the range
            v = np.float32(v * (1 - 2.0**-23)).astype(np.float64)
            v = np.where(np.round(v / unit) * unit == v, v, 0.0)
        return np.reshape(v, shape)

    def input(self, dtype=None, shape=None, secret=True, most: float | None = None) -> Bounded:
        dtype = np.dtype(dtype or (self.float if self.coin(0.7) else self.one([*INTEGERS, np.bool_])))
        shape = self.one(SHAPES) if shape is None else shape
        value = (
            self.values(shape, dtype, self.reference.product_bound) if secret or dtype.kind != "f" else None
        )
        if value is None:
            value = np.asarray(np.asarray(self.constant(shape), dtype), np.float64)
        return Bounded(value, np.zeros(value.shape), dtype, secret)

    # --- operands ---

    def pick(
        self, values: list[Bounded], kind=None, *, secret=True, small=True, like=None, where=lambda x: True
    ) -> int:
        """The number of a value, often the last; raises `Outside` where there is none."""
        fit = [
            i
            for i, x in enumerate(values)
            if (kind is None or x.kind in kind)
            and (x.secret or not secret)
            and (not small or x.value.size <= 64)
            and (like is None or (x.dtype == like.dtype and x.shape in ((), like.shape)))
            and where(x)
        ]
        if not fit:
            raise Outside
        if self.coin(0.4):  # so that steps follow upon one another
            return fit[-1]
        weights = np.array([2.0 + i for i in range(len(fit))])
        return fit[self.rng.choice(len(fit), p=weights / weights.sum())]

    def step(self, values: list[Bounded]) -> Step:
        name = self.one(STEPS)
        return Step(name, *CHOICES[name](self, values))


def _one(kind, *, small=True, where=lambda x: True):
    return lambda d, v: ((d.pick(v, kind, small=small, where=where),), ())


def _two(kind, *, public=False):
    def choose(d: Draw, v):
        i = d.pick(v, kind)
        j = d.pick(v, kind, like=v[i], secret=not (public and d.coin(0.5)))
        return (i, j) if d.coin(0.5) or v[j].shape != v[i].shape else (j, i), ()

    return choose


def _axis(kind, *, small=True):
    def choose(d: Draw, v):
        large = 64 if not small and d.coin(0.7) and any(x.value.size > 64 for x in v) else 0
        i = d.pick(v, kind, small=small, where=lambda x: x.value.ndim > 0 and x.value.size > large)
        axes = v[i].value.ndim
        return (i,), (int(d.rng.integers(axes)) if small else d.one([0, None]),)

    return choose


def _with_constant(d: Draw, v, kind=("float",), small=False):
    i = d.pick(v, kind, small=small)
    shape = v[i].shape if v[i].value.size <= 64 and d.coin(0.4) else ()
    return (i,), (d.constant(shape),)


def _public(d: Draw, v, kind, shape=()):
    return d.pick(v, kind, secret=False, where=lambda x: not x.secret and x.shape == shape)


def _dot(d: Draw, v):
    i = d.pick(v, ("float", "int", "bool"), small=False, where=lambda x: x.value.ndim == 1)
    return (i, d.pick(v, small=False, where=lambda x: x.dtype == v[i].dtype and x.shape == v[i].shape)), ()


def _table(d: Draw, v):
    i = d.pick(v, ("float",), where=lambda x: x.value.ndim > 0)
    return (i,), (d.constant((v[i].shape[-1], 2)),)


def _choice_of_constants(d: Draw, v):
    i = d.pick(v, ("float",))
    b = d.pick(v, ("bool",), where=lambda x: x.shape in ((), v[i].shape))
    return (b, i), (d.constant(), d.constant())


def _where(d: Draw, v):
    i = d.pick(v, ("float", "int"))
    j = d.pick(v, like=v[i])
    return (d.pick(v, ("bool",), secret=False, where=lambda x: x.shape in ((), v[i].shape)), i, j), ()


def _masked(d: Draw, v):
    i = d.pick(v, ("float",), where=lambda x: x.value.ndim > 0 and x.shape[-1] > 1)
    hidden = d.rng.random(v[i].shape) < 0.4
    hidden[..., d.rng.integers(v[i].shape[-1])] = False
    low = float(np.finfo(v[i].dtype).min)
    return (i,), (hidden, d.one([-np.inf, -1e9, low]))


def _dtypes(d: Draw, v):
    i = d.pick(v)
    options = {"float": [np.bool_], "bool": [np.int32, d.float], "int": [*INTEGERS, np.bool_, d.float]}
    return (i,), (np.dtype(d.one(options[v[i].kind])).name,)


def _clip(d: Draw, v):
    low, high = sorted([float(d.constant()), float(d.constant())])
    return (d.pick(v, ("float",)),), (low, high)


def _copies(d: Draw, v):
    i = d.pick(v, ("float", "float", "int"), where=lambda x: x.value.ndim < 2)
    n = d.one([2, 10, 1000, 10_000, 100_000, 2**20])
    if n * max(v[i].value.size, 1) > d.widest:
        raise Outside
    return (i,), (n,)


def _joined(d: Draw, v):
    i = d.pick(v, where=lambda x: x.value.ndim > 0)
    return (
        i,
        d.pick(
            v, where=lambda x: x.dtype == v[i].dtype and x.shape[1:] == v[i].shape[1:] and x.value.ndim > 0
        ),
    ), ()


def _first_axis(parameters=lambda d, x: (), kind=None, least=1):
    def choose(d: Draw, v):
        i = d.pick(v, kind, where=lambda x: x.value.ndim > 0 and x.shape[0] >= least)
        return (i,), parameters(d, v[i])

    return choose


def _row(d: Draw, v, rows):
    i = d.pick(v, ("float", "int"), where=lambda x: x.value.ndim > 0)
    return i, d.pick(
        v, secret=False, where=lambda x: x.dtype == v[i].dtype and x.shape == (*rows, *v[i].shape[1:])
    )


def _scan(d: Draw, v):
    i = d.pick(v, ("float",), where=lambda x: x.value.ndim > 0)
    start = d.pick(v, ("float",), where=lambda x: x.dtype == v[i].dtype and x.shape == v[i].shape[1:])
    return (i, start), (int(d.rng.integers(len(BODIES))),)


def _body(d: Draw):
    return int(d.rng.integers(len(BODIES)))


def _product(d: Draw, v):
    """Two operands: the first secret, and with all entries of the product."""
    i = d.pick(v, ("float",))
    return i, d.pick(v, ("float",), like=v[i], secret=not d.coin(0.5))


def _beside_its_maximum(d: Draw, v):
    i, j = _product(d, v)
    return (i, j, d.pick(v, ("float",), like=v[i], secret=not d.coin(0.5))), (d.one(NAMES),)


CHOICES: dict[str, Callable[[Draw, list[Bounded]], tuple[tuple[int, ...], tuple[Any, ...]]]] = {
    "add": _two(("float", "int"), public=True),
    "sub": _two(("float", "int"), public=True),
    "mul": _two(("float", "int"), public=True),
    "neg": _one(("float", "int")),
    "square": _one(("float",), small=False),
    "power": lambda d, v: ((d.pick(v, ("float",)),), (int(d.rng.integers(2, 6)),)),
    "dot": _dot,
    "plus": _with_constant,
    "scaled": _with_constant,
    "divided": _with_constant,
    "forgotten": _with_constant,
    "over": lambda d, v: ((d.pick(v, ("float",)), _public(d, v, ("float",))), ()),
    "table": _table,
    "multiple": lambda d, v: ((d.pick(v, ("float", "int")),), (int(d.one([2, 3, 5, 100, 127])),)),
    "compare": lambda d, v: (_two(("float", "int"), public=True)(d, v)[0], (d.one(NAMES),)),
    "against": lambda d, v: (lambda c: (c[0], (*c[1], d.one(NAMES))))(_with_constant(d, v, small=True)),
    "maximum": _two(("float", "int"), public=True),
    "minimum": _two(("float", "int"), public=True),
    "relu": _one(("float",)),
    "clip": _clip,
    "abs": _one(("float",)),
    "sign": _one(("float", "int")),
    "where": _where,
    "one_of": _choice_of_constants,
    "over_one_of": _choice_of_constants,
    "sum": _axis(("float", "int", "bool"), small=False),
    "mean": _axis(("float",), small=False),
    "var": _axis(("float",), small=False),
    "cumsum": _one(("float", "int"), small=False, where=lambda x: x.value.ndim > 0),
    "max": _axis(("float", "int")),
    "min": _axis(("float", "int")),
    "argmax": _axis(("float", "int")),
    "argmin": _axis(("float",)),
    "masked_max": _masked,
    "convert": _dtypes,
    "logic": lambda d, v: (_two(("bool",))(d, v)[0], (d.one(["logical_and", "logical_or", "logical_xor"]),)),
    "logical_not": _one(("bool",)),
    "any": _axis(("bool",)),
    "all": _axis(("bool",)),
    "reshape": lambda d, v: ((i := d.pick(v),), ((v[i].value.size,),)),
    "transpose": _one(None, where=lambda x: x.value.ndim == 2),
    "reverse": _first_axis(),
    "part": _first_axis(lambda d, x: (1,), least=2),
    "copies": _copies,
    "padded": _first_axis(lambda d, x: (d.constant(),), ("float",)),
    "joined": _joined,
    "split": _one(None, where=lambda x: x.value.ndim > 0 and x.shape[0] % 2 == 0),
    "take": _first_axis(lambda d, x: (tuple(int(i) for i in d.rng.integers(x.shape[0], size=3)),)),
    "filled": _first_axis(lambda d, x: (d.one([0, 7, 5]),), ("float", "int")),
    "put": lambda d, v: (_row(d, v, ()), ()),
    "put_sum": lambda d, v: (_row(d, v, (2,)), ()),
    "slice_at": lambda d, v: ((d.pick(v, where=lambda x: x.value.ndim > 0), _public(d, v, ("int",))), ()),
    "update_at": lambda d, v: ((*_row(d, v, ()), _public(d, v, ("int",))), ()),
    "scan": _scan,
    "repeated": lambda d, v: ((d.pick(v, ("float",)),), (int(d.rng.integers(1, 4)), _body(d))),
    "until": lambda d, v: ((d.pick(v, ("float",)), _public(d, v, ("int",))), (_body(d),)),
    "branch": lambda d, v: ((d.pick(v, ("float",)), _public(d, v, ("bool",))), (_body(d), _body(d))),
    "slope": _with_constant,
    "product_slope": lambda d, v: (_product(d, v), (d.constant(),)),
    "product_beside_its_maximum": _beside_its_maximum,
    "largest_product": lambda d, v: (_product(d, v), ()),
}
RARE = {"scan", "repeated", "until", "branch", "slope", "product_slope"}  # each is compiled by itself
STEPS = [name for name in CHOICES for _ in range(1 if name in RARE else 3)]
STEPS += ["copies", "copies", "mul", "scaled", "sum", "mean", "var", "cumsum", "maximum", "clip"] * 3


def random_program(
    seed: tuple[int, ...], reference: Reference, *, steps: int = 5, widest: int = 20_000
) -> Program:
    """A program of which something is known: no step leaves the range, no error swamps its value."""
    draw = Draw(seed, reference, widest)
    public = [draw.input(draw.float, (), secret=False), draw.input(np.bool_, (), secret=False)]
    public.append(
        Bounded(np.asarray(draw.rng.integers(0, 3), np.int32), np.zeros(()), np.dtype(np.int32), secret=False)
    )
    shape = draw.one(SHAPES[1:])
    first = draw.input(draw.float, shape)
    # Often a product comes first that is as large as it may be.
    most = reference.product_bound / max(np.max(np.abs(first.value)), 1.0) if draw.coin(0.5) else None
    inputs = [first, draw.input(draw.float, shape, most=most), draw.input()]
    inputs += [draw.input(np.bool_, draw.one([(), shape])), *public]
    program, values = Program(inputs), list(inputs)
    begin = [Step("mul", (0, 1))] if most and draw.coin(0.5) else []
    for _ in range(100):
        if len(program.steps) == steps:
            break
        try:
            step = begin.pop() if begin else draw.step(values)
            with np.errstate(all="ignore"):
                result = step.run(reference, values)
            if result.kind == "float" and np.max(result.error, initial=0) > max(
                64 * reference.unit, 2.0**-8 * np.max(np.abs(result.value), initial=0)
            ):
                raise Outside
        except Outside:
            continue
        program.steps.append(step)
        values.append(result)
    return program
