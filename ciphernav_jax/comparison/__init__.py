"""One's own function over protocol variants and numbers of parties: time, cost, errors, memory.

- `rows`: what one variant with one number of parties gave.
- `subject`: the function with its arguments, its gradient, and what both give in float64.
- `timing`: seconds of compiling and of warm calls.
- `trials`: one variant with one number of parties, measured.
- `pictures`: all rows as a picture; imported where it is asked for, with matplotlib.
- `results`: `Comparison`: all rows, as tables, Markdown and JSON.
- `running`: `compare`.
"""

from ciphernav_jax.comparison.results import Comparison
from ciphernav_jax.comparison.rows import Row
from ciphernav_jax.comparison.running import compare

__all__ = ["Comparison", "Row", "compare"]
