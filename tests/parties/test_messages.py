"""What is read from a party's jaxpr, on programs made by hand; and a run that keeps its messages."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from ciphernav_jax.parties import party
from ciphernav_jax.parties.messages import depth, first_uses, openings
from ciphernav_jax.parties.party import ideal_sum, labelled, open_shares, open_sum, open_xor
from ciphernav_jax.parties.requests import Mask
from ciphernav_jax.parties.run import one_partys_jaxpr

from .simulated import on_shares, views

pytestmark = pytest.mark.newest_jax

PARTIES = 3


def traced(program, entries=4):
    shares = jax.ShapeDtypeStruct((PARTIES, entries), jnp.uint64)
    return one_partys_jaxpr(lambda x, _: (program(x), None), PARTIES, shares, None)[0]


def rounds(program):
    return [opening.rounds for opening in openings(traced(program))]


def double(x, _=None):
    """Two rounds, one after the other."""
    return open_xor(open_sum(x)), None


def test_an_opening_is_sent_in_the_round_after_those_it_depends_on():
    def program(x):
        a, b = open_sum(x), jax.jit(open_xor)(x + 1)  # one does not wait for the other
        c = open_shares(a + x)  # waits for a
        return c.sum(axis=0, dtype=jnp.uint64) + open_sum(b + open_sum(x)) + open_sum(c[0])

    assert rounds(program) == [(1,), (1,), (2,), (1,), (2,), (3,)]


def test_an_opening_says_what_is_sent_and_for_whom():
    @labelled
    def inner(x):
        return open_xor(x)

    @labelled
    def outer(x):
        return inner(x[:3])

    def program(x):
        with jax.named_scope("primitive:scan"), jax.named_scope("primitive:max"):
            return jax.jit(outer)(x)

    (opening,) = openings(traced(program))
    assert (opening.collective, opening.protocol, opening.primitive) == ("open_xor", "outer", "max")
    assert (opening.shape, opening.words, opening.size) == ((3,), 3, 24)


def test_a_scan_is_multiplied_out():
    def program(x):
        x = open_sum(x)
        x, _ = lax.scan(double, x, length=3)
        return open_sum(x)

    assert rounds(program) == [(1,), (2, 4, 6), (3, 5, 7), (8,)]
    scanned = openings(traced(program))[1]
    assert scanned.words == 3 * 4


def test_scans_within_scans_and_loops_without_messages():
    def outer(x, _):
        x, _ = lax.scan(double, x, length=2)
        x, _ = lax.scan(lambda c, _: (c + 1, None), x, length=5)
        return open_sum(x), None

    assert rounds(lambda x: lax.scan(outer, x, length=2)[0]) == [(1, 3, 6, 8), (2, 4, 7, 9), (5, 10)]


def test_of_a_cond_the_costliest_branch_is_counted():
    def program(x):
        public = open_sum(x)[0]
        x = lax.cond(
            public > 3, lambda x: open_sum(jnp.tile(x, 9)).reshape(9, -1)[0], lambda x: double(x)[0], x
        )
        return open_sum(x)

    found = openings(traced(program))
    assert [o.rounds for o in found] == [(1,), (2,), (3,), (4,)]
    assert [o.words for o in found] == [4, 4, 4, 4]


def test_a_while_is_counted_once_and_says_so():
    def program(x):
        return open_sum(lax.while_loop(lambda x: open_shares(x)[0, 0] < 9, lambda x: double(x)[0], x))

    found = openings(traced(program))
    assert [(o.rounds, o.per_iteration) for o in found] == [
        ((1,), True),
        ((2,), True),
        ((3,), True),
        ((4,), False),
    ]


def test_an_ideal_sum_is_no_message():
    found = openings(traced(lambda x: open_sum(ideal_sum(open_sum(x)))))
    assert [(o.rounds, o.words, o.ideal) for o in found] == [
        ((1,), 4, False),
        ((2,), 0, True),
        ((2,), 4, False),
    ]
    assert depth(found) == 2


def test_an_opening_where_rounds_cannot_be_counted_is_refused():
    with pytest.raises(ValueError, match="opens something inside `custom_vmap_call`"):
        openings(traced(jax.custom_batching.sequential_vmap(open_sum)))


def test_first_uses_are_found_through_wrappers_and_loops_in_their_order():
    def program(a, b, c, unused, d):
        def step(carry, _):
            with jax.named_scope("third"):
                return carry + c, None

        with jax.named_scope("first"):
            b = jax.jit(lambda b, d: b * 2)(b, d)
        with jax.named_scope("second"):
            a = a + b
        with jax.named_scope("loop"):
            return lax.scan(step, a + a, length=2)[0]

    jaxpr = jax.make_jaxpr(program)(*[1.0] * 5).jaxpr
    uses = first_uses(jaxpr)
    assert list(uses) == [1, 0, 2]
    assert [stack.strip("/") for stack in uses.values()] == ["first", "second", "loop/third"]


def looped(reverse):
    """A running sum over rows, each opened under its own mask, then once more what is left."""

    def program(dealer, x):
        masks = dealer.take(Mask((5, 8)))["mask"]

        def step(total, row):
            i, mask = row
            opened = open_sum(total + mask)
            return total + i * x, opened ^ i

        total, seen = lax.scan(step, x, (jnp.arange(5, dtype=jnp.uint64), masks), reverse=reverse)
        return total, seen, open_shares(total)

    return program


@pytest.mark.parametrize("reverse", [False, True])
def test_messages_of_a_loop_are_kept_in_the_order_in_which_they_were_sent(reverse):
    x = np.arange(8, dtype=np.uint64)
    program = looped(reverse)
    in_loop, after = views(program, PARTIES)(0, x)
    total, seen, rows = on_shares(program, PARTIES)(0, x)
    index = np.arange(5, dtype=np.uint64)[:, None]
    expected = (np.asarray(seen[0]) ^ index)[:: -1 if reverse else 1]
    assert in_loop.sent.shape == (PARTIES, 5, 8)
    np.testing.assert_array_equal(in_loop.opened, expected)
    np.testing.assert_array_equal(in_loop.sent.sum(axis=0, dtype=np.uint64), expected)
    assert in_loop.opening.rounds == (1, 2, 3, 4, 5)
    np.testing.assert_array_equal(after.sent, total)
    np.testing.assert_array_equal(after.opened, rows[0])


@pytest.mark.parametrize(
    "program",
    [
        lambda _, x: lax.cond(open_sum(x)[0] > 3, open_sum, lambda x: x, x),
        lambda _, x: lax.while_loop(lambda x: x[0] < 9, lambda x: open_sum(x), open_sum(x)),
    ],
)
def test_messages_that_may_not_have_been_sent_are_not_made_up(program):
    with pytest.raises(NotImplementedError, match=r"cannot record what is opened inside `(cond|while)`"):
        views(program, PARTIES)(0, np.arange(4, dtype=np.uint64))


def test_ideal_sums_leave_no_message():
    def program(_, x):
        return party.from_party_zero(ideal_sum(x)) + party.from_party_zero(open_sum(x))

    (message,) = views(program, PARTIES)(0, np.arange(4, dtype=np.uint64))
    assert message.name == "open_sum"
