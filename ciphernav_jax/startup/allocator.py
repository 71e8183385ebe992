"""The C library's allocator, told to keep large buffers.

XLA allocates a step's temporary buffer at each call. By default glibc maps a buffer above 32 MB afresh and
returns it when it is freed, so at each call the system clears its pages again and maps them one by one: at
five parties that took longer than the step itself. Kept in the heap, the buffer is there the next time. The
process then holds up to 2 GB of freed memory. An environment that sets MALLOC_... variables or GLIBC_TUNABLES
itself is left alone, as are systems without glibc.
"""

import ctypes
import os

# From glibc's malloc.h.
M_TRIM_THRESHOLD = -1
M_MMAP_MAX = -4
M_ARENA_MAX = -8

SETTINGS = {
    M_ARENA_MAX: 1,  # the heaps of further arenas are too small for large buffers
    M_MMAP_MAX: 0,
    M_TRIM_THRESHOLD: 2**31 - 1,
}


def keep_large_buffers() -> bool:
    """Sets the allocator up; whether it was done. Best before JAX starts its threads."""
    if any(name.startswith("MALLOC_") or name == "GLIBC_TUNABLES" for name in os.environ):
        return False
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):  # not glibc
        return False
    return all(mallopt(option, value) for option, value in SETTINGS.items())
