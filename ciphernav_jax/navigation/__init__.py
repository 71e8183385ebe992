"""Training, plain and secret, and closed-loop navigation. In reading order:

- `methods`: what each method of the paper's table sees.
- `owners`: who holds what, and what is secret.
- `samples`: teacher-forced samples of a data set.
- `features`: each party encodes its own views.
- `plain`: encoders and classifier, end to end, in plaintext.
- `classifier`: a fresh classifier on frozen features: what `learning` is given.
- `sight`: what a robot sees for itself, straight ahead.
- `rollout`: closed-loop episodes, with any policy.
- `policies`: classifiers, plain and secret, as policies.
- `folders`: training folders, and what is in them.
- `trainings`: trainings in their folders.
- `driving`: driving with what a training left.
- `pictures`: PNGs.
- `paper`, `metrics`: counts, accuracies, the table beside the paper's.
"""

from ciphernav_jax import extras

extras.require("navigation", "ciphernav_jax.navigation")
