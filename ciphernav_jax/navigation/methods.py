"""What each method of the paper's table sees (paper, section 5)."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Method:
    """A way to navigate, by what it sees besides the map.

    Attributes:
        cameras: whether it has the four cameras' views.
        agent_view: whether it has the robot's own view.
        fixed_start: whether the robot always starts heading right, the top lane in view.
    """

    cameras: bool
    agent_view: bool
    fixed_start: bool = False


METHODS = {
    "map-only": Method(cameras=False, agent_view=False),
    "first-person": Method(cameras=False, agent_view=True),
    "first-person-deterministic": Method(cameras=False, agent_view=True, fixed_start=True),
    "plaintext": Method(cameras=True, agent_view=True),
}
"""By name; the classifiers trained on frozen features see what `plaintext` sees."""
