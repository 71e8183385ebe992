"""Who holds what, and what is secret."""

from dataclasses import dataclass

CAMERAS = ("bottom_left", "bottom_right", "top_left", "top_right")
SLOTS: tuple[str, ...] = (*CAMERAS, "agent", "map")  # the order of the classifier's input


@dataclass(frozen=True)
class Party:
    """A party and the slots of the classifier's input that it alone sees in the clear."""

    name: str
    slots: tuple[str, ...]


def cast(parties: int) -> tuple[Party, ...]:
    """The parties of a computation: first the robot, which holds its own view and the map.

    Fewer than five parties have one owner of all four cameras, five or more have an owner for
    each (paper, section 5). Whoever is left over holds shares and nothing else.

    Raises:
        ValueError: with fewer than two parties nothing can be secret.
    """
    if parties < 2:
        raise ValueError(f"secret sharing needs at least two parties, not {parties}; choose --parties 2 or 5")
    robot = Party("robot", ("agent", "map"))
    if parties < 5:
        owners = (Party("camera owner", CAMERAS),)
    else:
        owners = tuple(Party(f"owner of camera {camera}", (camera,)) for camera in CAMERAS)
    helpers = parties - 1 - len(owners)
    return (robot, *owners, *(Party(f"helper {index + 1}", ()) for index in range(helpers)))


def statement(parties: int, *, public_weights: bool = False) -> str:
    """What is secret, what is opened and who holds what, in words; the classifier's weights too, or not."""
    held = {"agent": "its own view, the map with its place and goal, and the right actions"}
    lines = [f"{parties} parties; each sees one share, a uniformly random number, of every secret:"]
    for party in cast(parties):
        things = [held.get(slot, f"camera {slot}") for slot in party.slots if slot != "map"]
        lines.append(f"  - {party.name}: {', '.join(things) or 'shares only'}")
    of_classifier = "what is computed from them"
    if not public_weights:
        of_classifier += ", the classifier's weights and gradients"
    lines += [
        f"secret: every view's features, the map, the right actions, {of_classifier}",
        f"public: the encoders{', the classifier' if public_weights else ''}, the networks' sizes, "
        "the order of the batches, how many steps each path has",
        "opened: in training, after every chunk of steps, the sum of its losses and the number of right "
        "answers in its last batch; in use the chosen action",
    ]
    return "\n".join(lines)
