"""The option reaches XLA. In processes of their own: XLA reads it once."""

from pathlib import Path

import pytest

from tests.fresh import printed

CPU = Path("/proc/cpuinfo")

SHOW = "import os; print(os.environ['XLA_FLAGS'])"
# Whether a product multiplies 512 or 256 bits at a time: VPMULLQ, EVEX.66.0F38.W1 40 with L'L = 2 or 1.
PRODUCT = """
import re, sys, pathlib, ciphernav_jax, jax, jax.numpy as jnp
from ciphernav_jax import ring
words = jnp.ones((64, 64), jnp.uint64)
jax.jit(ring.matmul)(words, words).block_until_ready()
code = b"".join(path.read_bytes() for path in pathlib.Path(sys.argv[1]).glob("*matmul*.o"))
found = re.findall(rb"(?s)\\x62(?=(.)(.)(.)\\x40)", code)
lengths = {p2[0] >> 5 & 3 for p0, p1, p2 in found if p0[0] & 7 == 2 and p1[0] & 0x87 == 0x85}
print(2 in lengths, 1 in lengths)
"""


def prints(code, *arguments, **environment):
    return printed(code, *arguments, without="XLA_FLAGS", JAX_COMPILATION_CACHE_DIR="", **environment)


def test_other_flags_are_kept_and_a_chosen_width_holds():
    code = "import ciphernav_jax;" + SHOW
    assert prints(code) == "--xla_cpu_prefer_vector_width=512"
    assert prints(code, XLA_FLAGS="--xla_a=1") == "--xla_a=1 --xla_cpu_prefer_vector_width=512"
    chosen = "--xla_cpu_prefer_vector_width=256"
    assert prints(code, XLA_FLAGS=chosen) == chosen


@pytest.mark.skipif(
    not CPU.exists() or "avx512dq" not in CPU.read_text(),
    reason="needs a processor with 512-bit products of words",
)
def test_products_of_words_are_compiled_to_wide_vectors(tmp_path):
    for name, flags, widths in (
        ("wide", "", "True False"),
        ("narrow", " --xla_cpu_prefer_vector_width=256", "False True"),
    ):
        dump = tmp_path / name
        flags = f"--xla_dump_to={dump} --xla_dump_hlo_as_text" + flags
        assert prints(PRODUCT, str(dump), XLA_FLAGS=flags) == widths
