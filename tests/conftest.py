import jax
from jaxtyping import install_import_hook

from tests import shapes

# Before the package is imported: its shape annotations are executed.
install_import_hook("ciphernav_jax", f"{shapes.__name__}.check")

import ciphernav_jax  # noqa: E402, F401  (switches 64-bit types on)

# A uint64 that meets a signed or floating operand must be an error, never a silent float64.
jax.config.update("jax_numpy_dtype_promotion", "strict")


def pytest_addoption(parser):
    parser.addoption(
        "--every-combination",
        action="store_true",
        help="test the whole product of protocol variants and party counts: an hour or two",
    )
