"""All that parties see together, bit by bit: no linear relation holds among its bits.

For fixed secrets the view of a coalition is uniform: its own shares, what the dealer gives it, and what
the others send are independent bits, so that over many runs they have full rank over GF(2), with a constant
beside them. A deficit is a relation that holds in every run: a mask used twice, a value without a mask, a
constant sent. It is found whatever messages it joins, where a look at each message alone, or at pairs, sees
nothing. What is opened is not looked at beside what is sent, since it is computed from that.

Full rank with a constant, for each of two secrets, also means that no linear function of the view tells the
secrets apart. Relations that are not linear are beyond these tests, as are openings that `view` refuses to
record (in `cond` and in `while`).
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, get_args

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from jax.extend.core import Primitive

import ciphernav_jax as cn
from ciphernav_jax.parties.party import from_party_zero, open_sum
from ciphernav_jax.parties.requests import Mask
from ciphernav_jax.protocols import compare, convert, masked, suite, truncate
from ciphernav_jax.secret import bounds, view
from ciphernav_jax.secret.rules import RULES
from ciphernav_jax.secret.value import Value

from ..slow import slow

WORD = 64
SPARE = 64  # more runs than bits: independent bits then fail to have full rank with probability 2^-64

# Programs of one party, called from a function as a primitive of its own.
part_p = Primitive("part")
part_p.def_abstract_eval(lambda *operands, program: operands[0])


@pytest.fixture(autouse=True)
def parts(monkeypatch):
    def rule(context, *operands, program):
        return Value(context, 0, bounds.SIGNED, share=program(context.dealer, *[x.share for x in operands]))

    monkeypatch.setitem(RULES, "part", rule)


def part(program):
    return lambda *operands: part_p.bind(*operands, program=program)


# --- the rank -----------------------------------------------------------------------------------------


def dependent(rows: np.ndarray) -> list[int]:
    """The columns of a matrix of bits that are sums, modulo 2, of columns before them."""
    packed = np.packbits(rows, axis=1, bitorder="little")
    m = np.pad(packed, ((0, 0), (0, -packed.shape[1] % 8))).view(np.uint64)
    rank, found = 0, []
    for column in range(rows.shape[1]):
        word, bit = divmod(column, WORD)
        (ones,) = np.nonzero(m[rank:, word] >> np.uint64(bit) & np.uint64(1))
        if not ones.size:
            found.append(column)
            continue
        pivot, *others = ones + rank
        m[[rank, pivot]] = m[[pivot, rank]]
        m[others, word:] ^= m[rank, word:]
        rank += 1
    return found


def test_dependent_columns_are_found():
    free = np.random.default_rng(0).integers(2, size=(300, 150), dtype=np.uint8)
    assert dependent(free) == []
    both = (free[:, 3] ^ free[:, 70])[:, None]
    constant = np.ones((300, 1), np.uint8)
    assert dependent(np.hstack([constant, free, both, free, 1 - both])) == [*range(151, 303)]


# --- what is looked at --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Case:
    """A function with two choices of its secrets, which are equal in every run.

    Of words shared by exclusive or the lowest `lanes` bits are looked at: those of the first values where a
    word holds one bit of 64 values, the lowest positions where it holds the bits of one.
    """

    function: Callable[..., Any]
    secrets: tuple[tuple[Any, ...], ...]
    protocol: cn.Protocol = field(default_factory=cn.Protocol)
    lanes: int = 2
    parties: tuple[int, ...] = (2, 3)


def observer(case: Case, parties: int):
    """(key, secrets) -> the view of a run with shares and randomness of its own."""
    observed = view(cn.secure(case.function, protocol=case.protocol))

    def once(key, secrets):
        sharing, dealing = jax.random.split(key)
        return observed(dealing, *cn.share(sharing, secrets, parties=parties, protocol=case.protocol))[1]

    return once


def words_of(seen, coalition: tuple[int, ...], parties: int):
    """What a coalition sees in all runs: (name, words with the runs as leading axis, by exclusive or?)."""
    others = [p for p in range(parties) if p not in coalition]
    for i, x in enumerate(seen.inputs):
        yield from ((f"share of argument {i}", x[:, p], False) for p in coalition)
    for i, (x, binary) in enumerate(zip(seen.dealt, seen.binary, strict=True)):
        yield from ((f"dealt value {i}", x[:, p], binary) for p in coalition)
    for message in seen.messages:
        binary = message.opening.collective == "open_xor"
        yield from ((f"sent in {message.name}", message.sent[:, p], binary) for p in others)


def bits_of(words: np.ndarray, count: int) -> np.ndarray:
    """uint8[runs, ...], the lowest `count` bits of each word."""
    octets = np.ascontiguousarray(words).reshape(len(words), -1, 1).view(np.uint8)
    return np.unpackbits(octets, axis=-1, bitorder="little", count=count).reshape(len(words), -1)


def table(case: Case, seen, coalition: tuple[int, ...], parties: int) -> tuple[list[str], np.ndarray]:
    """Names of columns, and the columns: a constant and all that a coalition sees, a row for each run."""
    names, columns = ["a constant"], []
    for name, words, binary in words_of(seen, coalition, parties):
        columns.append(bits_of(words, case.lanes if binary else WORD))
        names += [f"{name}, to parties {coalition}"] * columns[-1].shape[1]
    return names, np.concatenate([np.ones((len(columns[0]), 1), np.uint8), *columns], axis=1)


def relations(case: Case, parties: int) -> list[set[str]]:
    """For each of the secrets: whose bits are sums of other bits in every run, in the view of any coalition
    short of all.
    """
    coalitions = [c for n in range(1, parties) for c in itertools.combinations(range(parties), n)]
    once = observer(case, parties)
    shapes = jax.eval_shape(once, jax.random.key(0), case.secrets[0])
    nothing = jax.tree.map(lambda x: np.zeros((1, *x.shape), x.dtype), shapes)
    most = max(table(case, nothing, c, parties)[1].size for c in coalitions)
    keys = jax.random.split(jax.random.key(11), most + SPARE)
    run = jax.jit(jax.vmap(once, in_axes=(0, None)))
    found = []
    for secrets in case.secrets:
        seen = jax.tree.map(np.asarray, run(keys, secrets))
        tables = [table(case, seen, coalition, parties) for coalition in coalitions]
        found.append({names[i] for names, x in tables for i in dependent(x[: len(names) + SPARE])})
    return found


# --- protocols and their variants ---------------------------------------------------------------------

NARROW = cn.Protocol(frac_bits=2, range_bits=2)  # signs by few bits
FLOATS = ((np.zeros(1), np.zeros(1)), (np.array([1.25]), np.array([-2.5])))
PAIRS = ((np.zeros(2),), (np.array([1.25, 1.25]),))
INTEGERS = ((np.zeros(1, np.int64),), (np.array([-(2**40) + 12345]),))


def products(x, y):
    return x * y, x**3, jnp.dot(x, x)


def choices(x, y):
    return jnp.where(x > 0, x, y), jnp.maximum(x * y, 0)


def loop(x):
    return lax.scan(lambda carry, each: (carry * each, carry), x[0], x)


def truncations(dealer, x):
    ways = truncate.probabilistic, truncate.nearest, truncate.floor
    return sum([way(dealer, x, 4).share() for way in ways], truncate.wrap_count(dealer, x, 4))


def signs(comparison, **circuit):
    """The sign of a value below 2^4 by each adder, one after the other."""

    def program(dealer, x):
        adders = get_args(suite.Adder)
        return sum(
            comparison(dealer, x, compare.Circuit(adder=a, sign_bit=4, **circuit)).share() for a in adders
        )

    return part(program)


def to_bits(dealer, x):
    return convert.to_bits(dealer, x)[0]


def to_ring(dealer, x):
    return convert.to_ring(dealer, jnp.tile(x, (64, 1)), (1,))


CASES = {
    "products": Case(products, FLOATS),
    "truncations": Case(part(truncations), INTEGERS),
    "signs": Case(signs(compare.positive), INTEGERS),
    "signs in words": Case(signs(compare.positive, layout="words"), INTEGERS, lanes=6),
    "signs by resharing": Case(signs(compare.resharing), INTEGERS),
    "sign in the whole ring": Case(jnp.sign, INTEGERS, lanes=1),
    "sign, all lanes": Case(jnp.sign, PAIRS, NARROW, lanes=WORD, parties=(2,)),
    "choices": Case(choices, FLOATS, NARROW),
    "arg max": Case(jnp.argmax, PAIRS, NARROW),
    "arg max by a tree": Case(jnp.argmax, PAIRS, replace(NARROW, argmax="tree")),
    "all 64 bits": Case(part(to_bits), INTEGERS, lanes=1, parties=(2,)),
    "from 64 bits": Case(part(to_ring), INTEGERS, lanes=1, parties=(2,)),
    "loop": Case(loop, PAIRS),
    "chacha20": Case(jnp.square, PAIRS, cn.Protocol(generator="chacha20"), parties=(2,)),
}


@pytest.mark.parametrize(
    ("name", "parties"), slow(*((name, p) for name, case in CASES.items() for p in case.parties))
)
def test_all_bits_that_a_coalition_sees_are_independent(name, parties):
    assert relations(CASES[name], parties) == [set(), set()]


# --- planted leaks ------------------------------------------------------------------------------------


def _opened(dealer, x, mask):
    return from_party_zero(open_sum(x + mask)) - mask


def one_mask_for_two(dealer, x, y):
    mask = dealer.take(Mask(x.shape))["mask"]
    return _opened(dealer, x, mask) + _opened(dealer, y, mask)


def no_mask(dealer, x, y):
    return masked.open_masked(dealer, x).share() + from_party_zero(open_sum(y))


def masks_that_add_up(dealer, x, y):
    """Each of three openings alone is uniform, and so are any two together."""
    a, b = (dealer.take(Mask(x.shape))["mask"] for _ in range(2))
    return _opened(dealer, x, a) + _opened(dealer, y, b) + _opened(dealer, x, a + b)


def a_mask_of_even_numbers(dealer, x, y):
    return _opened(dealer, x, 2 * dealer.take(Mask(x.shape))["mask"]) + y


LEAKS = (one_mask_for_two, no_mask, masks_that_add_up, a_mask_of_even_numbers)
TWO_INTEGERS = tuple((x[0], x[0] + 1) for x in INTEGERS)


@pytest.mark.parametrize("leak", LEAKS, ids=lambda leak: leak.__name__)
def test_planted_leaks_are_found(leak):
    for found in relations(Case(part(leak), TWO_INTEGERS), 3):
        assert found
        assert all("open_sum" in name for name in found)
