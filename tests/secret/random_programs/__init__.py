"""Random small programs: evaluated on secrets, and held to bounds that are derived from what is promised.

- `operations`: what a step of a program does, in JAX, and what loops and branches do.
- `reference`: the same operations in float64, with a bound on the error of each entry.
- `program`: inputs and steps.
- `checking`: a program evaluated on secrets, and the fault that is found reduced to a step or two.
- `drawing`: programs at random.
- `variants`: the protocols that they run on.

`python -m tests.secret.random_programs` draws and checks thousands, of every variant and several numbers of
parties.
"""
