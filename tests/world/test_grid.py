import numpy as np
import pytest

from ciphernav_jax.world import grid

# The specification's table: open inner cells as row * 10 + column.
OPEN = [
    {21}, {21, 22}, {22, 23}, {23}, {12}, {12, 22}, {22, 32}, {32},
    {21, 22, 23}, {12, 22, 32}, {21, 22, 23, 12, 32}, set(),
]  # fmt: skip
INNER = {10 * row + column for row in (1, 2, 3) for column in (1, 2, 3)}


def test_layouts_are_the_specified_ones():
    assert len(grid.LAYOUTS) == 12
    for picture, walls, opened in zip(grid.LAYOUTS, grid.WALLS, OPEN, strict=True):
        closed = {10 * (cell // 5) + cell % 5 for cell in np.flatnonzero(walls)}
        assert closed == INNER - opened, picture


def test_layout_probabilities():
    np.testing.assert_allclose(grid.LAYOUT_PROBABILITIES, [0.05] * 8 + [0.15] * 4)
    assert grid.LAYOUT_PROBABILITIES.sum() == pytest.approx(1)


def test_border_is_free_and_has_16_cells():
    assert len(grid.BORDER) == 16
    assert not grid.WALLS[:, list(grid.BORDER)].any()


@pytest.mark.parametrize(
    ("cell", "action", "expected"),
    [
        (0, 0, 0),
        (0, 1, -1),
        (0, 2, 5),
        (0, 3, -1),
        (0, 4, 1),
        (12, 1, 7),
        (12, 3, 11),
        (4, 4, -1),
        (24, 2, -1),
    ],
)
def test_move(cell, action, expected):
    assert grid.move(cell, action) == expected


def test_move_takes_arrays():
    np.testing.assert_array_equal(grid.move(np.array([0, 12]), np.array([4, 2])), [1, 17])


@pytest.mark.parametrize(
    ("cell", "heading", "ahead"),
    [
        (0, 0, [-1, -1, -1, -1]),
        (0, 3, [1, 2, 3, 4]),
        (12, 0, [7, 2, -1, -1]),
        (12, 1, [17, 22, -1, -1]),
        (13, 2, [12, 11, 10, -1]),
    ],
)
def test_rays_go_straight_ahead_to_the_edge(cell, heading, ahead):
    assert grid.RAYS[cell, heading].tolist() == ahead
    assert grid.RAYS.dtype == np.int8


def test_map_code():
    picture = grid.map_code(grid.WALLS[0], 3, 24).reshape(5, 5)
    np.testing.assert_array_equal(
        picture, [[0, 0, 0, 1, 0], [0, 4, 4, 4, 0], [0, 0, 4, 4, 0], [0, 4, 4, 4, 0], [0, 0, 0, 0, 2]]
    )
    assert picture.dtype == np.uint8


def test_map_code_shows_the_agent_on_the_goal_and_takes_batches():
    codes = grid.map_code(grid.WALLS[[0, 11]], np.array([7, 5]), np.array([5, 5]))
    assert codes.shape == (2, 25)
    assert codes[0, 5] == grid.GOAL
    assert codes[1, 5] == grid.AGENT
    assert grid.GOAL not in codes[1]
