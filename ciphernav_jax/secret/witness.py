"""What only a simulation can know of a program: its values, noted equation by equation while it is traced.

A `Witness` is told of every equation and of every truncation. It adds up the shares and takes notes: a row of
numbers for each equation. Beside each secret it can carry a *reference*: the same program evaluated in
float64 on the same inputs. An error is the distance from the reference, so it is that of the whole program so
far.

Every trace of a part of a program, the body of a loop or a branch, has a witness of its own. Its notes leave
the part as outputs do, and those of all iterations are merged.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from ciphernav_jax import jax_private
from ciphernav_jax.jax_private import JaxprEqn
from ciphernav_jax.parties.party import AXIS, ideal_sum
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.secret.places import UNKNOWN, Place
from ciphernav_jax.secret.value import Value

# A truncation takes ring elements below this magnitude, in bits.
RANGE_BITS = 62
# A product is truncated before it is compared or selected. What is off by more units than this is wrong.
UNITS = 8
# A float64 sum that is smaller than its terms by this factor is their rounding.
ROUNDING = 2.0**-50

# Counted always; beside references also these. Of `signal` and `faint_signal`: sums of magnitudes.
COUNTS = ("truncations", "failed")
COUNTS_BESIDE = ("values", "faint", "differing", "wrong", "not_numbers")
SUMS_BESIDE = ("signal", "faint_signal")
LARGEST_BESIDE = ("magnitude", "error")

# An equation has lost range where one of these is larger.
LOST = {"magnitude": 1, "failed": 0, "wrong": 0, "not_numbers": 0}

COMPARISONS = {"eq", "ne", "gt", "lt", "ge", "le", "sign"}
SELECTIONS = {"max", "min", "clamp", "abs", "reduce_max", "reduce_min"}
# Where a public number beyond the range stands for an infinity.
MASKABLE = COMPARISONS | SELECTIONS | {"add", "sub", "select_n"}
SUMS = {"add", "add_any", "sub", "reduce_sum", "cumsum"}
SCATTERS = {"scatter": lax.scatter, "scatter-add": lax.scatter_add}


@dataclass(frozen=True)
class Site:
    """An equation of the user's function: the primitive, and the line that it comes from."""

    primitive: str
    place: Place


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Notes:
    """Numbers for each of a program's equations, in its order; a pytree.

    Attributes:
        sites: the equations.
        largest: by name arrays [..., n]; of several runs the largest counts.
        total: by name arrays [..., n]; of several runs the sum counts.
        first: of the equation that lost range before all others, in the order of the run: its number, counted
            from 1, and the magnitude that it had then. 0 where none did.
    """

    sites: tuple[Site, ...] = field(metadata={"static": True})
    largest: dict[str, Array]
    total: dict[str, Array]
    first: tuple[Array, Array]

    def merged(self, later: "Notes") -> "Notes":
        """Of this run and a later one of the same program."""
        return Notes(
            self.sites,
            jax.tree.map(jnp.maximum, self.largest, later.largest),
            jax.tree.map(jnp.add, self.total, later.total),
            _earlier(self.first, later.first),
        )

    def over_runs(self) -> "Notes":
        """Of all runs that the leading axes number: those of a scan or a vmap around the step."""

        def over(reduce: Callable[..., Array], x: Array) -> Array:
            return reduce(x, axis=tuple(range(x.ndim - 1)))

        run = jnp.argmax(self.first[0].reshape(-1) > 0)
        return Notes(
            self.sites,
            jax.tree.map(partial(over, jnp.max), self.largest),
            jax.tree.map(partial(over, jnp.sum), self.total),
            jax.tree.map(lambda x: x.reshape(-1)[run], self.first),
        )

    @staticmethod
    def joined(parts: Sequence["Notes"]) -> "Notes":
        """Of the parts of one program, in its order."""
        first, before = parts[0].first, 0
        for part in parts:
            number, magnitude = part.first
            first = _earlier(first, (jnp.where(number > 0, number + before, 0), magnitude))
            before += len(part.sites)
        columns = [(part.largest, part.total) for part in parts]
        largest, total = jax.tree.map(lambda *x: jnp.concatenate(x), *columns)
        return Notes(tuple(site for part in parts for site in part.sites), largest, total, first)


def _earlier(first: tuple[Array, Array], later: tuple[Array, Array]) -> tuple[Array, Array]:
    number, magnitude = first
    return jnp.where(number > 0, number, later[0]), jnp.where(number > 0, magnitude, later[1])


class Row:
    """The numbers of one equation while it is traced, 0 where none is noted."""

    def __init__(self, site: Site):
        self.site = site
        self.numbers: dict[str, Any] = {}

    def add(self, name: str, number: Any) -> None:
        self.numbers[name] = self.numbers.get(name, 0) + number

    def enlarge(self, name: str, number: Any) -> None:
        self.numbers[name] = jnp.maximum(self.numbers.get(name, 0.0), number)

    def notes(self, beside: bool) -> Notes:
        """As notes with this one equation."""

        def column(name: str, dtype: Any) -> Array:
            return jnp.asarray(self.numbers.get(name, 0), dtype)[None]

        counts, sums, largest = COUNTS, (), ()
        if beside:
            counts, sums, largest = COUNTS + COUNTS_BESIDE, SUMS_BESIDE, LARGEST_BESIDE
        lost = jnp.zeros((), jnp.int64)
        for name, most in LOST.items():
            lost |= jnp.asarray(self.numbers.get(name, 0) > most, jnp.int64)
        magnitude = jnp.asarray(self.numbers.get("magnitude", 0), jnp.float64)
        return Notes(
            (self.site,),
            {name: column(name, jnp.float64) for name in largest},
            {name: column(name, jnp.int64) for name in counts}
            | {name: column(name, jnp.float64) for name in sums},
            (lost, magnitude),
        )


class Witness:
    """Stands beside one trace of a program, or of a part of it.

    Attributes:
        beside: whether references are carried along. Without, only truncations are counted.
    """

    def __init__(self, protocol: Protocol, beside: bool):
        self.protocol = protocol
        self.beside = beside
        self._noted: list[Row | Notes] = []
        self._row = Row(Site("", UNKNOWN))

    def inside(self) -> "Witness":
        """The witness of another trace, or of a part."""
        return Witness(self.protocol, self.beside)

    # --- what it is told ---

    def at(self, primitive: str, place: Place) -> None:
        """An equation is about to be evaluated."""
        self._row = Row(Site(primitive, place))
        self._noted.append(self._row)

    def given(self, name: str, value: Value, dtype: np.dtype) -> None:
        """A secret argument. Its word -2^63 stands for what was no number, under a trace, when it was shared
        or computed.
        """
        self.at("argument", Place("", 0, name))
        value.row = self._row
        if self.beside:
            with jax.named_scope("witness"):
                reference = _decoded(value, dtype)
                if _is_float(dtype):
                    reference = jnp.where(_word(value) == np.iinfo(np.int64).min, jnp.nan, reference)
                value.reference = reference
                self._note(value, reference, dtype, RANGE_BITS - self.protocol.frac_bits)

    def evaluated(self, eqn: JaxprEqn, operands: Sequence[Any], results: Sequence[Any]) -> None:
        """The equation has these results."""
        for value in results:
            if isinstance(value, Value):
                # A result may be one of the operands itself, or of an earlier equation.
                value.row = value.row or self._row
        if not self.beside or not any(isinstance(x, Value) for x in results):
            return
        with jax.named_scope("witness"):
            references = _apply(eqn, self._references(eqn, operands))
            for value, reference, dtype in zip(results, references, _dtypes(eqn.outvars), strict=True):
                if isinstance(value, Value):
                    # A sum of two products may be larger: it is truncated in parts.
                    self._note(value, reference, dtype, RANGE_BITS + (not value.truncatable))
                    self._check(eqn, operands, value)
                    value.reference = reference if value.reference is None else value.reference

    def truncated(self, value: Value, shift: int, after: Value, *, clipped: bool = False) -> None:
        """A value has lost its last `shift` bits; `clipped`: what is negative became 0.

        This counts for the equation that made the value.
        """
        row = value.row or self._row
        with jax.named_scope("witness"):
            before = _word(value)
            if clipped:
                before = jnp.maximum(before, 0)
            exact = before >> shift
            far = jnp.abs(_word(after) - exact) > lax.axis_size(AXIS)
            row.add("truncations", far.size)
            row.add("failed", jnp.sum(far, dtype=jnp.int64))
            if value.waits and value.reference is not None:
                self._note_faint(row, _float(value.reference), before != 0)

    def include(self, notes: Notes) -> None:
        """A part has been evaluated, with these notes."""
        self._noted.append(notes)

    def notes(self) -> Notes:
        """All that was noted; where only truncations are counted, of the equations that have some."""
        parts = [
            part.notes(self.beside) if isinstance(part, Row) else part
            for part in self._noted
            if self.beside or isinstance(part, Notes) or part.numbers
        ]
        # An equation without a name: notes are never empty.
        return Notes.joined(parts or [Row(Site("", UNKNOWN)).notes(self.beside)])

    # --- references ---

    def reference(self, x: Any, dtype: np.dtype) -> Array | None:
        """The reference of an operand whose dtype is that: of a float a float64. None where none is kept."""
        if not self.beside:
            return None
        if isinstance(x, Value):
            x = _decoded(x, dtype) if x.reference is None else x.reference
        return jnp.asarray(x, _wide(dtype))

    def abstract_reference(self, aval: Any) -> jax.ShapeDtypeStruct | None:
        """The shape of such a reference."""
        return jax.ShapeDtypeStruct(aval.shape, _wide(aval.dtype)) if self.beside else None

    def _references(self, eqn: JaxprEqn, operands: Sequence[Any]) -> list[Any]:
        dtypes = _dtypes(eqn.invars)
        return [
            self._unmasked(eqn, x, self.reference(x, dtype))
            for x, dtype in zip(operands, dtypes, strict=True)
        ]

    def _unmasked(self, eqn: JaxprEqn, operand: Any, reference: Any) -> Any:
        """What is added to or compared with secrets, and lies beyond their range, stands for an infinity."""
        if isinstance(operand, Value) or eqn.primitive.name not in MASKABLE or not _is_float(reference.dtype):
            return reference
        beyond = jnp.abs(reference) >= 2.0 ** (RANGE_BITS - 1 - self.protocol.frac_bits)
        return jnp.where(beyond, jnp.copysign(jnp.inf, reference), reference)

    # --- what it notes ---

    def _note(self, value: Value, reference: Array, dtype: np.dtype, range_bits: int) -> None:
        row, found = self._row, _decoded(value, dtype)
        row.add("values", found.size)
        if not _is_float(dtype):
            row.add("differing", _count(found != reference))
            return
        known = jnp.isfinite(reference)
        row.add("not_numbers", _count(jnp.isnan(reference)))
        # An integer that became a float has room, but as a result it has none.
        frac_bits = max(value.frac_bits, self.protocol.frac_bits)
        largest = jnp.maximum(jnp.abs(found), jnp.abs(reference)) * 2.0 ** (frac_bits - range_bits)
        # What stands apart as an excess is in nobody's way.
        row.enlarge(
            "magnitude", _largest(largest, known if value.excess is None else known & (value.excess == 0))
        )
        row.enlarge("error", _largest(jnp.abs(found - reference) * 2.0**self.protocol.frac_bits, known))
        row.add("signal", jnp.sum(jnp.abs(reference), where=known))
        # With more fractional bits than at rest it has more resolution, until it is truncated.
        self._note_faint(row, reference, known & ((found == 0) | (not value.waits)))

    def _note_faint(self, row: Row, reference: Array, where: Array) -> None:
        size = jnp.abs(reference)
        faint = where & (size > 0) & (size < 2.0**-self.protocol.frac_bits)
        row.add("faint", _count(faint))
        row.add("faint_signal", jnp.sum(size, where=faint))

    def _check(self, eqn: JaxprEqn, operands: Sequence[Any], result: Value) -> None:
        """Counts wrong comparisons and selections, judged by what the secrets are, not the references."""
        name = eqn.primitive.name
        if name not in COMPARISONS | SELECTIONS:
            return
        found = [
            _decoded(x, dtype) if isinstance(x, Value) else self._unmasked(eqn, x, self.reference(x, dtype))
            for x, dtype in zip(operands, _dtypes(eqn.invars), strict=True)
        ]
        unit = 2.0**-self.protocol.frac_bits
        (dtype,), (exact,) = _dtypes(eqn.outvars), _apply(eqn, found)
        chosen = _decoded(result, dtype)
        if name in COMPARISONS:
            apart = jnp.abs(_float(found[0]) - (_float(found[1]) if len(found) == 2 else 0))
            wrong = (chosen != exact) & (apart > UNITS * unit)
        else:
            wrong = (jnp.abs(_float(chosen) - _float(exact)) > UNITS * unit) & jnp.isfinite(_float(exact))
        self._row.add("wrong", _count(wrong))


def _is_float(dtype: np.dtype) -> bool:
    return jnp.issubdtype(dtype, np.floating)


def _wide(dtype: Any) -> Any:
    """The dtype of a reference."""
    return np.dtype(np.float64) if _is_float(dtype) else dtype


def _float(x: Array) -> Array:
    return x.astype(jnp.float64)


def _word(x: Value) -> Array:
    """The ring element itself, as a signed number."""
    return lax.bitcast_convert_type(ideal_sum(x.share), jnp.int64)


def _decoded(x: Value, dtype: np.dtype) -> Array:
    """The secret itself: of a float a float64."""
    if not _is_float(dtype):
        return _word(x).astype(dtype)
    found = _float(_word(x)) * 2.0**-x.frac_bits
    if x.excess is None:
        return found
    excess = lax.bitcast_convert_type(x.excess, jnp.int64)
    return found + _float(excess) * 2.0**-x.context.protocol.frac_bits


def _count(x: Array) -> Array:
    return jnp.sum(x, dtype=jnp.int64)


def _largest(x: Array, where: Array) -> Array:
    return jnp.max(x, where=where, initial=0.0)


def _dtypes(atoms: Sequence[Any]) -> list[np.dtype]:
    return [atom.aval.dtype for atom in atoms]


def _apply(eqn: JaxprEqn, operands: list[Any]) -> list[Any]:
    """The equation on references: its own primitive, with float64 for all floats."""
    name = eqn.primitive.name
    if name in SCATTERS:
        names = ("dimension_numbers", "indices_are_sorted", "unique_indices", "mode")
        return [SCATTERS[name](*operands, **{key: eqn.params[key] for key in names})]
    params = {
        name: _wide(parameter) if isinstance(parameter, np.dtype) else parameter
        for name, parameter in eqn.params.items()
    }
    results = jax_private.bind(eqn.replace(params=params), operands)
    if name not in SUMS or not _is_float(operands[0].dtype):
        return results
    (result,), sizes = results, [jnp.abs(x) for x in operands]
    terms = sizes[0] + sizes[1] if len(sizes) == 2 else jax_private.bind(eqn.replace(params=params), sizes)[0]
    return [jnp.where(jnp.abs(result) <= ROUNDING * _float(terms), jnp.zeros_like(result), result)]
