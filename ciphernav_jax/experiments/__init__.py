"""Measurements. In reading order:

- `work`: what is computed, the same for everybody: ordinary JAX functions and their inputs.
- `variants`: protocol variants as words of a command line.
- `floor`: what a work needs at least, at rates measured on the spot.
- `measure`: one work, one number of parties, one process.
- `peers`: other frameworks on the same work, each in a virtual environment of its own.
- `bench`: all of it, in one table.
- `primitives`: rounds, bytes and error of each primitive, for docs/primitives.md.
"""
