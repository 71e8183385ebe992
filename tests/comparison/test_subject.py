import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import ciphernav_jax as cn
from ciphernav_jax.comparison.subject import subject

X = np.array([1.5, -2.0], np.float32)


def test_the_reference_is_float64_whatever_the_arguments_are():
    x = np.full(10, 0.1, np.float32)
    (found,) = subject(lambda x: jnp.sum(x), (x,), ()).expected
    assert found == np.sum(x, dtype=np.float64)
    assert found != np.sum(x)


def test_a_float32_that_the_function_holds_is_widened():
    found = subject(lambda x: x * np.float32(0.1), (X,), ())
    assert found.reference == "float64"
    np.testing.assert_array_equal(found.expected[0], X.astype(np.float64) * np.float64(np.float32(0.1)))


def test_a_function_that_takes_its_own_dtypes_alone_says_so():
    def carried(x):
        return lax.scan(lambda total, x: (total + x * x, None), jnp.float32(0), x)[0]

    found = subject(carried, (X,), ())
    assert found.reference == found.configuration()["reference"] == "own"
    assert found.expected == [6.25]
    np.testing.assert_array_equal(found.expected_gradient, [[3.0, -4.0]])


def test_the_gradient_is_that_of_all_float_results_by_all_secret_float_arguments():
    def function(tree, public, count):
        return {"a": tree["x"] ** 2 * public, "b": jnp.sum(tree["y"]).astype(jnp.float32), "n": count + 1}

    args = ({"x": X, "y": np.ones(3)}, np.float32(3), np.int64(4))
    found = subject(function, args, (1,))
    assert [x.tolist() for x in found.expected_gradient] == [[9.0, -12.0], [1.0, 1.0, 1.0]]
    assert found.public == (1,)
    assert found.configuration()["arguments"] == {
        "args[0]['x']": "float32[2]",
        "args[0]['y']": "float64[3]",
        "args[1]": "float32[]",
        "args[2]": "int64[]",
    }


@pytest.mark.parametrize(
    ("function", "args", "why"),
    [
        (lambda x: jnp.argmax(x), (X,), "no result is a float"),
        (lambda n: n * jnp.float32(0.5), (np.float32(1).astype(np.int32),), "no secret argument is a float"),
        (lambda x: lax.while_loop(lambda x: x[0] < 9, lambda x: x + 1, x), (X,), "does not differentiate it"),
    ],
)
def test_without_a_gradient_there_is_a_reason(function, args, why):
    jax.config.update("jax_numpy_dtype_promotion", "standard")
    try:
        found = subject(function, args, ())
    finally:
        jax.config.update("jax_numpy_dtype_promotion", "strict")
    assert why in found.no_gradient
    assert found.gradient is None


def test_the_digest_is_of_all_that_decides_results():
    def relu(scale):
        return lambda x: jax.nn.relu(x * np.full(2, scale, np.float32))

    digests = [
        subject(relu(2), (X,), ()).digest,
        subject(relu(3), (X,), ()).digest,  # what it closes over
        subject(relu(2), (X + 1,), ()).digest,
        subject(relu(2), (X.astype(np.float64).astype(np.float32)[::-1],), ()).digest,
        subject(lambda x, y: relu(2)(x), (X, X), ()).digest,
        subject(lambda x, y: relu(2)(x), (X, X), (1,)).digest,
    ]
    assert len(set(digests)) == len(digests)
    assert subject(relu(2), (X.copy(),), ()).digest == digests[0]


def test_a_function_of_another_derivative_is_another_one():
    def scaled(factor):
        @jax.custom_vjp
        def function(x):
            return x * 2

        function.defvjp(lambda x: (x * 2, None), lambda _, g: (g * factor,))
        return function

    assert subject(scaled(2), (X,), ()).digest != subject(scaled(3), (X,), ()).digest


@pytest.mark.parametrize(
    ("args", "public", "error", "message"),
    [
        ((X,), (1,), ValueError, "there is none of number 1"),
        ((X,), (-1,), ValueError, "there is none of number -1"),
        ((X,), (0,), ValueError, "no argument is left to be secret"),
        ((cn.share(jax.random.key(0), X, parties=2),), (), TypeError, "an argument is a Secret"),
    ],
)
def test_arguments_that_cannot_be_compared_are_refused(args, public, error, message):
    with pytest.raises(error, match=message):
        subject(lambda x: x, args, public)


@pytest.mark.parametrize("gradients", [True, False])
@pytest.mark.parametrize(
    "within",
    [
        lambda b: lambda x: x + b,
        lambda b: lambda x: jax.jit(lambda y: y + b)(x),
        lambda b: lambda x: jax.jit(lambda y: jax.jit(lambda z: z * b)(y))(x),
        lambda b: lambda x: lax.scan(lambda c, _: (jax.jit(lambda y: y + b)(c), None), x, length=2)[0],
        lambda b: lambda x: lax.cond(x[0] > 9, lambda x: x, lambda x: x + b, x),
    ],
)
def test_what_a_function_closes_over_tells_it_from_others(within, gradients):
    b = np.linspace(0, 1, 2000)
    x = np.ones(2000)
    one, same, other = (subject(within(c), (x,), (), gradients).digest for c in (b, b.copy(), 1000 * b))
    assert one == same != other
