import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from ciphernav_jax.models import ActionClassifier, Convolution, MapEncoder, Navigator, ViewEncoder


def parameters(module):
    return sum(leaf.size for leaf in jax.tree.leaves(nnx.state(module, nnx.Param)))


def test_view_encoder_has_the_papers_parameters():
    encoder = ViewEncoder(nnx.Rngs(0))
    layers = [encoder.near, encoder.far, encoder.hidden, encoder.features]
    assert [parameters(layer) for layer in layers] == [456, 906, 83_072, 4_128]


def test_map_encoder_has_the_papers_parameters():
    encoder = MapEncoder(nnx.Rngs(0))
    layers = [encoder.first, encoder.second, encoder.features]
    assert [parameters(layer) for layer in layers] == [1_664, 8_320, 16_512]


def test_classifier_has_the_papers_parameters():
    layers = ActionClassifier(nnx.Rngs(0)).layers
    assert [parameters(layer) for layer in layers] == [36_992, 8_256, 1_040, 85]


def test_navigator_is_the_sum_of_its_parts():
    assert parameters(Navigator(nnx.Rngs(0))) == 88_562 + 26_496 + 46_373


@pytest.mark.parametrize(("shape", "block"), [((45, 60, 3), 14), ((21, 28, 6), 6), ((21, 28, 6), 1)])
def test_convolution_and_its_gradients_equal_xlas(shape, block):
    layer = Convolution(shape[-1], 6, size=5, stride=2, block=block, rngs=nnx.Rngs(1))
    images = jax.random.normal(jax.random.key(0), (3, *shape), jnp.float32)

    def reference(kernel, images):
        return jax.lax.conv_general_dilated(
            images, kernel, (2, 2), "VALID", dimension_numbers=("NHWC", "HWIO", "NHWC")
        )

    def ours(kernel, images):
        graph, state = nnx.split(layer)
        return nnx.merge(graph, {**nnx.to_pure_dict(state), "kernel": kernel})(images)

    kernel = layer.kernel[...]
    weights = jax.random.normal(
        jax.random.key(1), jax.eval_shape(reference, kernel, images).shape, jnp.float32
    )

    def forward_and_backward(convolve):
        output, transpose = jax.vjp(convolve, kernel, images)
        return output, transpose(weights)

    expected, gradients = jax.jit(lambda: forward_and_backward(reference))()
    actual, our_gradients = jax.jit(lambda: forward_and_backward(ours))()
    np.testing.assert_allclose(actual, expected, atol=1e-5)
    for gradient, other in zip(our_gradients, gradients, strict=True):
        np.testing.assert_allclose(gradient, other, rtol=1e-4, atol=1e-3)


def test_convolution_says_when_blocks_do_not_fit():
    layer = Convolution(3, 6, size=5, stride=2, block=5, rngs=nnx.Rngs(0))
    with pytest.raises(ValueError, match="blocks of 5"):
        layer(jnp.zeros((1, 45, 60, 3), jnp.float32))


def test_networks_take_raw_bytes_and_return_float32():
    views = jnp.zeros((2, 45, 60, 3), jnp.uint8)
    maps = jnp.zeros((2, 25), jnp.uint8)

    @nnx.jit
    def run(navigator, views, maps):
        view, place = navigator.view_encoder(views), navigator.map_encoder(maps)
        return view, place, navigator.classifier(jnp.concatenate([view] * 5 + [place], axis=-1))

    view, place, logits = run(Navigator(nnx.Rngs(0)), views, maps)
    assert (view.shape, place.shape, logits.shape) == ((2, 32), (2, 128), (2, 5))
    assert {view.dtype, place.dtype, logits.dtype} == {jnp.dtype("float32")}
