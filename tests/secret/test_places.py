"""A refusal names the line of the user's own, wherever the operation stands."""

import contextlib
import functools
import importlib
import inspect
import re

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from flax import nnx
from jax import lax

import ciphernav_jax as cn
from ciphernav_jax.secret import places, view

KEY = jax.random.key(0)
NAN = np.array([np.nan, 1.0])
ADAM = optax.adam(0.1)
STATE = ADAM.init(jnp.ones(2))


def line(mark):
    """The number of the line that has this mark as a comment."""
    source, start = inspect.getsourcelines(inspect.getmodule(line))
    (found,) = [i for i, text in enumerate(source, max(start, 1)) if text.endswith(f"# {mark}\n")]
    return found


def named(message):
    """The file and the line that a refusal names."""
    ((file, number),) = re.findall(r"It comes from (\S+\.py):(\d+)", message)
    return file, int(number)


class Linen(nn.Module):
    @nn.compact
    def __call__(self, x):
        x = nn.Dense(2)(x)
        return nn.LayerNorm()(x)  # linen


WEIGHTS = Linen().init(KEY, jnp.ones(2, jnp.float32))


class Nnx(nnx.Module):
    def __init__(self):
        self.layer = nnx.Linear(2, 2, rngs=nnx.Rngs(0))

    def __call__(self, x):
        return nnx.gelu(self.layer(x))  # nnx


def norm(x):
    return jnp.linalg.norm(x)  # norm


def norm_again(x):
    return jnp.linalg.norm(x)  # norm again


def deviation(x):
    jitted = jax.jit(jax.vmap(jax.grad(jnp.std)))
    return jitted(x[None])  # deviation


def scanned(x):
    return lax.scan(lambda carry, x: (carry, jnp.sinc(x)), 0.0, x)[1]  # scanned


def looped(x, n):
    def step(state):
        return state[0] + 1, state[1] ** 2

    return lax.while_loop(lambda state: state[0] < n, step, (0, x))  # looped


def branched(x, n):
    return lax.cond(n > 0, jnp.square, lambda x: x, x)  # branched


def chosen(x):
    return lax.cond(x[0] > 0, lambda x: x, jnp.negative, x)  # chosen


def entropy(x):
    return optax.sigmoid_binary_cross_entropy(x, jnp.ones(2))  # entropy


def adam(x):
    return ADAM.update(x, STATE)[0]  # adam


def adam_scanned(x):
    def body(state, _):
        return ADAM.update(x, state)[1], ADAM.update(x, state)[0]  # adam, scanned

    return lax.scan(body, STATE, None, length=2)


def told(x):
    return jax.vmap(importlib.import_module("told_of").told)(x)  # told


def averaged(x, y):
    return jnp.average(x, weights=y)  # averaged


def multiplied(x, y):
    larger = x + 1
    return y * larger  # multiplied


def contracted(x, y):
    twice = 2 * x
    return twice @ y  # contracted


NOT_FINITE = {"averaged": averaged, "multiplied": multiplied, "contracted": contracted}


WRAPPED = contextlib.contextmanager(lambda: iter([None]))()(jnp.exp)


def decorated(x):
    return WRAPPED(x)  # decorated


REFUSED = {
    "norm": norm,
    "norm again": norm_again,
    "deviation": deviation,
    "scanned": scanned,
    "chosen": chosen,
    "linen": lambda x: Linen().apply(WEIGHTS, x),
    "nnx": lambda x: Nnx()(x),
    "entropy": entropy,
    "adam": adam,
    "adam, scanned": adam_scanned,
    "decorated": decorated,
}


@pytest.fixture
def x():
    return cn.share(jax.random.key(1), np.array([1.5, -2.0]), parties=2)


@pytest.mark.newest_jax
@pytest.mark.parametrize("mark", REFUSED)
def test_an_operation_has_the_users_line(mark, x):
    standard = jax.numpy_dtype_promotion("standard")  # libraries' layers are of float32
    with standard, pytest.raises(NotImplementedError, match="It comes from") as refused:
        cn.cost(cn.secure(REFUSED[mark]), x)
    assert named(str(refused.value)) == (__file__, line(mark))


@pytest.mark.newest_jax
@pytest.mark.parametrize(
    "function",
    [
        jnp.exp,
        jax.jit(jnp.exp),
        jax.vmap(jnp.tanh),
        functools.partial(jnp.logaddexp, 1.0),
        nn.softmax,
        optax.safe_norm,
    ],
)
def test_a_librarys_function_has_the_line_that_makes_it_secure(function, x):
    arguments = (x, 0.0) if function is optax.safe_norm else (x,)
    step = cn.secure(function)  # made secure
    with pytest.raises(NotImplementedError, match="It comes from") as refused:
        jax.eval_shape(step, KEY, *arguments)
    assert named(str(refused.value)) == (__file__, line("made secure"))


@pytest.mark.parametrize("mark", ["averaged", "multiplied", "contracted"])
def test_a_public_number_that_is_none_has_the_line_where_it_meets_the_secret(mark, x):
    with pytest.raises(ValueError, match="It comes from") as refused:
        cn.secure(NOT_FINITE[mark])(jax.random.key(2), x, NAN)
    assert named(str(refused.value)) == (__file__, line(mark))


def test_a_public_number_that_a_librarys_function_meets_has_the_line_that_makes_it_secure(x):
    product = cn.secure(jnp.multiply)  # product
    for key in jax.random.split(jax.random.key(3)):
        with pytest.raises(ValueError, match="It comes from") as refused:
            product(key, x, NAN)
        assert named(str(refused.value)) == (__file__, line("product"))


def test_a_callback_in_a_library_has_the_line_that_calls_it(x, tmp_path, monkeypatch):
    folder = tmp_path / "site-packages"
    folder.mkdir()
    (folder / "told_of.py").write_text(
        "import jax\n\n\n@jax.jit\ndef told(x):\n    jax.debug.callback(print, x)\n    return x\n"
    )
    monkeypatch.syspath_prepend(folder)
    with pytest.raises(NotImplementedError, match="reaches out of the function") as refused:
        cn.cost(cn.secure(told), x)
    assert named(str(refused.value)) == (__file__, line("told"))


@pytest.mark.newest_jax
@pytest.mark.parametrize(("function", "mark"), [(looped, "looped"), (branched, "branched")])
def test_what_cannot_be_recorded_has_the_users_line(function, mark, x):
    for observed in (cn.transcript, view):
        with pytest.raises(NotImplementedError, match="cannot record what is opened inside") as refused:
            jax.eval_shape(observed(cn.secure(function)), KEY, x, 3)
        assert f", at test_places.py:{line(mark)}:" in str(refused.value)


def test_a_function_has_the_line_of_its_definition():
    place = places.of_function(norm)
    assert (place.file, place.line) == (__file__, line("norm") - 1)
    assert str(place) == f"{__file__}:{place.line} (norm)"
