"""A strided convolution as one matrix product over blocks of output columns (im2col).

XLA's CPU convolution is slow for few channels, and a plain im2col product is too narrow, having
only as many columns as output channels. Computing `block` neighbouring output columns from one
wider patch makes the product `block` times as wide, at the price of multiplying with some zeros.
"""

import jax.numpy as jnp
from flax import nnx
from jaxtyping import Array, Float


class Convolution(nnx.Module):
    """Square kernel, stride, no padding; the parameters are those of `nnx.Conv`.

    Args:
        inputs, outputs: channels.
        size: side of the kernel.
        stride: step of the kernel, the same both ways.
        block: output columns per product; the output's width must be a multiple of it.
        rngs: source of the initial kernel (He normal; the bias starts at 0).
    """

    def __init__(self, inputs: int, outputs: int, *, size: int, stride: int, block: int, rngs: nnx.Rngs):
        kernel = nnx.initializers.he_normal()(rngs.params(), (size, size, inputs, outputs), jnp.float32)
        self.kernel = nnx.Param(kernel)
        self.bias = nnx.Param(jnp.zeros(outputs, jnp.float32))
        self.stride = stride
        self.block = block

    def __call__(self, images: Float[Array, "n height width c"]) -> Float[Array, "n h w k"]:
        kernel, bias = self.kernel[...], self.bias[...]
        size, _, channels, outputs = kernel.shape
        count, height, width, _ = images.shape
        height, width = (height - size) // self.stride + 1, (width - size) // self.stride + 1
        if width % self.block:
            raise ValueError(f"an output {width} wide does not divide into blocks of {self.block} columns")

        # One copy of the kernel per output column of the block, each moved right by the stride.
        shifts = [self.stride * column for column in range(self.block)]
        band = jnp.stack(
            [jnp.pad(kernel, ((0, 0), (left, shifts[-1] - left), (0, 0), (0, 0))) for left in shifts], axis=3
        )
        span = size + shifts[-1]

        rows = [images[:, top : top + self.stride * (height - 1) + 1 : self.stride] for top in range(size)]
        stacked = jnp.stack(rows, axis=2)
        lefts = range(0, self.stride * width, self.stride * self.block)
        patches = jnp.stack([stacked[:, :, :, left : left + span] for left in lefts], axis=2)
        product = patches.reshape(-1, size * span * channels) @ band.reshape(-1, self.block * outputs)
        return product.reshape(count, height, width, outputs) + bias
