"""What ciphernav_jax is measured by: `python -m experiments`. In import order:

- `work`: what is computed, the same for everybody: ordinary JAX functions and their inputs.
- `options`: what each command can be told.
- `floor`: what a work needs at least, at rates measured on the spot.
- `process`: a process for each measurement, which ends with its parent.
- `measure`: one work, one number of parties, one process.
- `growth`: one work, all numbers of parties in turns, one process.
- `peers`: other frameworks on the same work, each in a virtual environment of its own.
- `bench`: all of it, in one table.
- `failures`: how often a truncation fails.
- `primitives`: rounds, bytes and error of each primitive, for docs/primitives.md.
- `programs`: many compiled functions in one process.
- `paper`: every table and figure of the paper at its full size, a script each.
- `report`: all results beside the paper's, on one page and as the README's tables.
- `pages`: parts of docs/ that are made from the library itself.
"""
