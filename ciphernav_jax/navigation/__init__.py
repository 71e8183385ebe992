"""Training, plain and secret, and closed-loop navigation. In reading order:

- `methods`: what each method of the paper's table sees.
- `parties`: who holds what, and what is secret.
- `samples`: teacher-forced samples of a data set.
- `features`: each party encodes its own views.
- `storage`: pytrees in files, and checkpoints that survive a kill.
- `plain`: encoders and classifier, end to end, in plaintext.
- `classifier`: a fresh classifier on frozen features, in plaintext or under secret sharing.
- `sight`: what a robot sees for itself, straight ahead.
- `rollout`: closed-loop episodes, with any policy.
- `policies`: classifiers, plain and secret, as policies.
- `trained`: training folders, and driving with what they hold.
- `progress`, `pictures`: bars, PNGs.
- `paper`, `metrics`: counts, accuracies, the table beside the paper's.
"""

from ciphernav_jax import extras

extras.require("navigation", "ciphernav_jax.navigation")
