import pytest

from ciphernav_jax.navigation.owners import CAMERAS, SLOTS, cast, statement


def test_two_parties_are_the_robot_and_one_owner_of_all_cameras():
    robot, owner = cast(2)
    assert (robot.slots, owner.slots) == (("agent", "map"), CAMERAS)


def test_five_parties_have_an_owner_for_each_camera():
    assert [party.slots for party in cast(5)] == [("agent", "map"), *((camera,) for camera in CAMERAS)]


@pytest.mark.parametrize("parties", [2, 3, 4, 5, 7])
def test_every_slot_has_one_owner_whoever_else_computes(parties):
    members = cast(parties)
    assert len(members) == parties
    assert sorted(slot for party in members for slot in party.slots) == sorted(SLOTS)


def test_helpers_hold_shares_only():
    assert "helper 1: shares only" in statement(3)
    assert "owner of camera top_left: camera top_left" in statement(5)


def test_one_party_has_no_secrets():
    with pytest.raises(ValueError, match="at least two parties"):
        cast(1)
