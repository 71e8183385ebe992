import jax

import ciphernav_jax  # noqa: F401  (switches 64-bit types on)

# A uint64 that meets a signed or floating operand must be an error, never a silent float64.
jax.config.update("jax_numpy_dtype_promotion", "strict")
