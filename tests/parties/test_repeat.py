"""Randomness for bodies of loops: fresh for each time, of the same kind as dealt once, and nested."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ciphernav_jax import ring
from ciphernav_jax.parties import sharing
from ciphernav_jax.parties.dealer import Planner, Supply
from ciphernav_jax.parties.repeat import OnCall, take_on_call, take_repeated
from ciphernav_jax.parties.requests import Bilinear, Mask, SharedBits, WrapCount, Zero
from ciphernav_jax.parties.run import run
from ciphernav_jax.ring import bits

from ..slow import slow

pytestmark = pytest.mark.newest_jax

TIMES = 4


def once(dealer):
    """A body that asks for values shared in each way, and for a product of two of them."""
    mask = dealer.take(Mask((5,), shift=20))
    shared = dealer.take(SharedBits((70,)))
    product = dealer.take(Bilinear(mask.ref("mask"), mask.ref("high"), ring.TIMES))
    zero = dealer.take(Zero((3,)))["zero"]
    own = dealer.take(WrapCount((5,)))
    named = {"own": own["mask"], "wraps": own["wraps"], "words": shared["words"], "bits": shared["bits"]}
    return named | {"mask": mask["mask"], "high": mask["high"], "product": product["product"], "zero": zero}


def planned(body):
    planner = Planner()
    jax.eval_shape(lambda: body(planner))
    return planner.plan()


def repeated(dealer, body=once, times=TIMES):
    """The body for each time, in a scan."""
    plan = planned(body)
    rows = take_repeated(dealer, plan, times)
    return jax.lax.scan(lambda _, row: (None, body(Supply(plan, row))), None, rows, length=times)[1]


def on_call(dealer, body=once):
    """The body for each time, the dealer on call."""
    plan = planned(body)
    seed = dealer.take(OnCall(plan))["seed"]
    calls = jnp.arange(TIMES)
    return jax.lax.scan(lambda _, i: (None, body(Supply(plan, take_on_call(seed, plan, i)))), None, calls)[1]


PROGRAMS = {
    "repeated": repeated,
    "on call": on_call,
    "repeated, repeated": lambda dealer: repeated(dealer, repeated),
    "on call, repeated": lambda dealer: repeated(dealer, on_call),
    "repeated, on call": lambda dealer: on_call(dealer, repeated),
}


@pytest.mark.parametrize("parties", [2, *slow(3)])
@pytest.mark.parametrize("name", PROGRAMS)
def test_each_time_has_consistent_randomness_of_its_own(name, parties):
    program = jax.jit(
        lambda key: run(lambda dealer, *_: (PROGRAMS[name](dealer), None), key, parties, None, None)[0]
    )
    shares = program(jax.random.key(3))
    joined = {name: sharing.join_sum(x) for name, x in shares.items()}
    mask, words = joined["mask"], sharing.join_xor(shares["words"])
    np.testing.assert_array_equal(joined["high"], mask >> np.uint64(20))
    np.testing.assert_array_equal(joined["product"], mask * joined["high"])
    np.testing.assert_array_equal(bits.unpack(words, (70,)), joined["bits"])
    np.testing.assert_array_equal(sharing.wraps(shares["own"]), joined["wraps"])
    assert not np.any(joined["zero"])
    assert np.shape(mask) == ((TIMES,) * (1 + name.count(",")) + (5,))
    # All shares differ from time to time, and from party to party.
    everything = np.concatenate([np.ravel(x) for x in (mask, words, *shares.values())])
    assert len(np.unique(everything)) == everything.size


def test_a_body_that_asks_for_nothing_takes_nothing():
    planner = Planner()
    assert take_repeated(planner, planned(lambda dealer: 0), 5) == []
    assert planner.plan().requests == ()
