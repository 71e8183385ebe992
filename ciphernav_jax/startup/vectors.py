"""XLA told to use the processor's widest vectors.

XLA's CPU backend computes in 256-bit vectors even where there are 512-bit ones, which slowed the clock of the
first processors that had them. The products modulo 2^64 are half as fast again with the wide ones (see
`ring.linear`). Elsewhere the option changes nothing. XLA reads it when JAX first computes; an XLA_FLAGS
that names a width is left alone.
"""

import os

OPTION = "--xla_cpu_prefer_vector_width"


def prefer_widest() -> None:
    """Adds the option to XLA_FLAGS."""
    flags = os.environ.get("XLA_FLAGS", "")
    if OPTION not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} {OPTION}=512".strip()
