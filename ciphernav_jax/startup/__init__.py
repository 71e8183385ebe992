"""What importing the package sets, before JAX is loaded or after.

- `allocator`: the C library's, told to keep large buffers.
- `compilation_cache`: what was compiled once is read from disk the next time.
- `vectors`: XLA told to use the processor's widest.

Ring elements are uint64, so JAX's 64-bit types are switched on as well.
"""

import os
import sys

from ciphernav_jax.startup import allocator, compilation_cache, vectors


def prepare() -> None:
    """All of it, without importing JAX to do it."""
    if "jax" in sys.modules:
        sys.modules["jax"].config.update("jax_enable_x64", True)
    else:
        os.environ["JAX_ENABLE_X64"] = "1"
    allocator.keep_large_buffers()
    compilation_cache.switch_on()
    vectors.prefer_widest()
