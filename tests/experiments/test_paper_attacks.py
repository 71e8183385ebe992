from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ciphernav_jax import files
from ciphernav_jax.models.encoders import MAP_FEATURES, VIEW_FEATURES
from ciphernav_jax.navigation import classifier
from ciphernav_jax.navigation.features import Features
from ciphernav_jax.navigation.owners import CAMERAS, SLOTS
from ciphernav_jax.parties import sharing
from ciphernav_jax.secret import share
from ciphernav_jax.world.grid import CELLS, DOWN, LEFT, RIGHT, STOP, WALLS
from experiments.paper import attack, queries, reconstruction
from experiments.paper.reconstruction import Look, Rows

pytestmark = pytest.mark.slow

RING = 11  # the layout without inner cells
WIDTHS = [MAP_FEATURES if slot == "map" else VIEW_FEATURES for slot in SLOTS]


def uniform(seed, *shape):
    return np.random.default_rng(seed).integers(2**64, size=shape, dtype=np.uint64)


def coins(seed, count):
    return np.random.default_rng(seed).integers(2, size=count)


@pytest.fixture(scope="module")
def rows():
    """Six robots at their start, with random features; a fixture, as uint64 arrays are made here too."""
    rng = np.random.default_rng(1)
    slots = tuple(rng.normal(size=(6, width)).astype(np.float32) for width in WIDTHS)
    return Rows(slots, np.eye(5, dtype=np.float32)[rng.integers(5, size=6)])


def encoded(values):
    return np.round(np.asarray(values, np.float64) * 2**20).astype(np.int64).view(np.uint64)


# The attackers.


def guessed(words, labels, attacker, read=attack.numbers):
    train, test = read(*np.split(words, 2))
    y, right = np.split(labels, 2)
    answers = attack.learn(train, y[:, None], test, 2, attack.ATTACKERS[attacker], 0)[:, 0]
    np.testing.assert_allclose(answers.sum(axis=-1), 1, rtol=1e-5)
    return np.mean(answers.argmax(axis=-1) == right)


@pytest.mark.parametrize("attacker", attack.ATTACKERS)
def test_an_attacker_finds_leaks_and_nothing_else(attacker):
    labels = coins(0, 4000)
    words = uniform(1, 4000, 20)
    by_chance = 4 * 0.5 / np.sqrt(2000)
    for read in (attack.numbers, attack.bits):
        assert abs(guessed(words, labels, attacker, read) - 0.5) < by_chance
    unmasked = np.concatenate([words, (100 * labels[:, None]).astype(np.uint64)], axis=1)
    assert guessed(unmasked, labels, attacker) > 0.95
    # One mask for all: what it hides differs by far less than a float of the words' size resolves.
    masked = words.copy()
    masked[:, 3] = np.uint64(2**64 - 50) + (100 * labels).astype(np.uint64)
    assert guessed(masked, labels, attacker) > 0.95


def test_a_single_bit_among_many_is_found():
    labels = coins(0, 4000)
    words = uniform(1, 4000, 20)
    words[:, 4] |= labels.astype(np.uint64)  # its lowest bit is 1, or as it may
    assert guessed(words, labels, "few columns", attack.bits) > 0.7


def test_an_attacker_answers_several_questions_at_once():
    x = np.random.default_rng(2).normal(size=(3000, 3)).astype(np.float32)
    truth = (x[:, :2] > 0).astype(int) + (x[:, :2] > 1)
    found = attack.learn(x[:2000], truth[:2000], x[2000:], 3, attack.Attacker((32,)), 0)
    assert found.shape == (1000, 2, 3)
    assert np.mean(found.argmax(axis=-1) == truth[2000:]) > 0.9
    again = attack.learn(x[:2000], truth[:2000], x[2000:], 3, attack.Attacker((32,)), 0)
    np.testing.assert_array_equal(found, again)


def test_numbers_are_relative_to_the_first_row():
    words = np.array([[2**64 - 1], [3], [7]], np.uint64)
    train, test = attack.numbers(words[:2], words[2:])
    np.testing.assert_allclose(train, [[-1], [1]])
    np.testing.assert_allclose(test, [[3]])  # 0, 4 and 8: two spreads further on


def test_bits_of_words():
    train, _ = attack.bits(np.array([[1, 2**63]], np.uint64), np.zeros((1, 2), np.uint64))
    assert train.shape == (1, 128)
    assert np.sum(train == 1) == 2


def test_classes_are_balanced():
    labels = np.array([1, 0, 1, 1, 1, 0, 1])
    chosen = attack.balanced(labels, 0)
    assert len(set(chosen.tolist())) == 4
    assert labels[chosen].sum() == 2


def test_an_interval_by_wilson():
    assert attack.score(50, 100) == {"hits": 50, "trials": 100, "accuracy": 50.0, "interval": [40.38, 59.62]}
    assert attack.score(10, 10)["interval"] == [72.25, 100.0]


def test_a_result_is_measured_once(tmp_path):
    path = tmp_path / "queries-3.json"

    def measure():
        return {"rate": 1.5}, {"part": 0.25}

    document = attack.recorded(path, 3, {"rows": 2}, measure)
    assert (document["name"], document["seed"], document["results"]) == ("queries", 3, {"rate": 1.5})
    assert set(document["seconds"]) == {"part", "all"}
    assert files.read_json(path) == attack.recorded(path, 3, {"rows": 2}, lambda: pytest.fail("again"))
    with pytest.raises(ValueError, match="another configuration"):
        attack.recorded(path, 3, {"rows": 3}, measure)


# What is attacked.


def test_labels_by_hand():
    obstacles = np.zeros((3, CELLS), bool)
    obstacles[0, 10] = True  # the left lane
    obstacles[1, [24, 2]] = True  # the corner of bottom and right, and the top
    found = reconstruction.labels(SimpleNamespace(obstacles=obstacles))
    assert CAMERAS == ("bottom_left", "bottom_right", "top_left", "top_right")
    np.testing.assert_array_equal(found, [[1, 0, 0, 0], [0, 1, 1, 1], [0, 0, 0, 0]])


def test_the_start(rows):
    views = np.arange(CELLS * 4 * 32, dtype=np.float32).reshape(-1, 32)
    seen = Features(
        cameras=rows.slots[:4],
        views=views,
        view_index=np.broadcast_to(np.arange(100, dtype=np.int32).reshape(CELLS, 4), (6, CELLS, 4)),
        maps=np.zeros((12, CELLS, CELLS, 128), np.float32),
        layout=np.full(6, RING, np.uint8),
        goal=np.full(6, 2, np.uint8),
    )
    actions = np.full((6, 17), -1, np.int8)
    actions[:, 0] = [4, 4, 2, 2, 4, 0]

    class World(SimpleNamespace):
        def __len__(self):
            return 6

    start = reconstruction.at_start(World(start_heading=np.array([3, 1, 3, 1, 1, 3]), actions=actions), seen)
    np.testing.assert_array_equal(start.slots[4], views[[3, 1, 3, 1, 1, 3]])
    np.testing.assert_array_equal(start.action.argmax(axis=1), actions[:, 0])


def seen_of(observe, rows, **options):
    return reconstruction.collect(observe, rows, 0, block=3, **options)


def test_features_and_shares_of_them(rows):
    np.testing.assert_array_equal(seen_of(reconstruction.own_features(2), rows), encoded(rows.slots[2]))
    shares = seen_of(reconstruction.robots_share(2), rows)
    assert len(np.unique(shares)) == shares.size == 6 * 32
    one_key = seen_of(reconstruction.robots_share(2), rows, reused=True)
    differences = encoded(rows.slots[2]) - encoded(rows.slots[2][:1])
    np.testing.assert_array_equal(one_key - one_key[:1], differences)


@pytest.fixture(scope="module")
def weights():
    return classifier.initial(0)


def sharing_of(parties):
    return lambda key, values: share(key, values, parties=parties)


def test_a_decision_as_the_robot_sees_it(rows, weights):
    both = reconstruction.forward(weights, [0], sharing_of(2), parts=("view", "output"))
    words = seen_of(both, rows)
    assert len(np.unique(words[:, :-7])) > 0.9 * words[:, :-7].size  # a 0 or 1 would come up again
    *_, action, shares = np.split(words, [-7, -2], axis=1)
    expected = classifier.predict(weights, rows.slots).argmax(axis=1)
    np.testing.assert_array_equal(action.argmax(axis=1), expected)
    np.testing.assert_array_equal(shares.sum(axis=1, dtype=np.uint64), expected)
    for camera in range(len(CAMERAS)):
        assert not np.isin(encoded(rows.slots[camera]), words).any()

    leaky = reconstruction.forward(weights, [0], reconstruction.to_robot_as_they_are(sharing_of(2)))
    for camera in range(len(CAMERAS)):
        assert np.isin(encoded(rows.slots[camera]), seen_of(leaky, rows)).all()


def test_a_sharing_that_keeps_nothing_leaks_to_all_others_alone(rows):
    slots = tuple(slot[:1] for slot in rows.slots)
    leaky = reconstruction.keeping_nothing(sharing_of(5))(jax.random.key(0), slots)
    for number, (secret, slot) in enumerate(zip(leaky, slots, strict=True)):
        np.testing.assert_array_equal(sharing.join_sum(secret.shares), encoded(slot))
        assert (number < len(CAMERAS)) == (not secret.shares[min(number, 3) + 1].any())
        assert len(np.unique(secret.shares[0])) == slot.size


def test_of_a_batch_the_first_rows_are_seen():
    numbers = [jnp.arange(8, dtype=jnp.uint64).reshape(2, 4), jnp.full(3, 100, jnp.uint64)]
    words = reconstruction._flat(reconstruction._of_first(numbers, 2, [jnp.full((2, 2), 200, jnp.uint64)]))
    np.testing.assert_array_equal(words[:4], [0, 1, 2, 3])
    np.testing.assert_array_equal(np.sort(words[4:]), [100] * 3 + [200] * 4)


def test_the_rows_of_an_attack(rows):
    truth = tuple(np.stack([coins(seed, n)] * 4, axis=1).astype(bool) for seed, n in ((0, 600), (1, 400)))
    sides = []
    for known in truth:
        slots = tuple(np.zeros((len(known), width), np.float32) + known[:, :1] for width in WIDTHS)
        sides.append(Rows(slots, np.zeros((len(known), 5), np.float32)))
    row = [Look(reconstruction.own_features(camera), (sides[0], sides[1]), [camera]) for camera in (0, 3)]
    found = reconstruction.outcome(row, (truth[0], truth[1]), 0)
    assert found["words"] == 32
    assert found["linear"]["bottom_left"]["trials"] == 2 * min(truth[1][:, 0].sum(), (~truth[1][:, 0]).sum())
    assert set(found["mlp"]) == {"bottom_left", "top_right", "all"}
    for attacker in attack.ATTACKERS:
        of_all = found[attacker]["all"]
        assert of_all["hits"] == of_all["trials"] == 2 * found[attacker]["bottom_left"]["trials"]
    hidden = Look(reconstruction.robots_share(0), (sides[0], sides[1]), [0])
    for look, reads in ((hidden, False), (hidden._replace(reused=True), True)):
        found = reconstruction.outcome([look], (truth[0], truth[1]), 0)["mlp"]["all"]
        assert found["accuracy"] == 100 if reads else found["accuracy"] < 65


# Queries.


def test_the_empty_view_is_the_one_that_comes_up_most():
    agent = np.full((4, CELLS, 4), -1, np.int32)
    agent[:, 3, 2] = [7, 9, 7, -1]  # in the last one the cell holds an obstacle
    agent[:, 4, 0] = [-1, -1, 5, -1]
    found = queries.empty_views(SimpleNamespace(agent=agent, layout=np.array([RING] * 4)))
    assert found[RING, 3, 2] == 7
    assert found[RING, 4, 0] == 5
    assert found[RING, 12, 0] == found[0, 3, 2] == -1


def test_every_question_is_asked(weights):
    rng = np.random.default_rng(3)
    layout = np.array([RING, 8, RING], np.uint8)
    seen = Features(
        cameras=tuple(rng.normal(size=(3, 32)).astype(np.float32) for _ in CAMERAS),
        views=np.zeros((1, 32), np.float32),
        view_index=np.zeros((3, CELLS, 4), np.int32),
        maps=rng.normal(size=(12, CELLS, CELLS, 128)).astype(np.float32),
        layout=layout,
        goal=np.zeros(3, np.uint8),
    )
    free = ~WALLS[layout]
    stands = free.copy()
    stands[0, 3] = False  # an obstacle
    index = np.where(stands[..., None], rng.integers(50, size=(3, CELLS, 4)), -1).astype(np.int32)
    eyes = queries.Eyes(rng.normal(size=(50, 32)).astype(np.float32), index)
    answers = queries.ask(weights, seen, eyes)
    asked = stands[:, :, None, None] & free[:, None, None, :]
    np.testing.assert_array_equal(answers != queries.UNASKED, np.broadcast_to(asked, answers.shape))
    count = 4 * np.sum(stands.sum(axis=1) * free.sum(axis=1))
    assert queries.questions_asked(answers) == round(count / 3, 1)

    env, cell, heading, goal = (np.array(x) for x in ([0, 1, 2], [2, 11, 24], [3, 0, 2], [20, 12, 1]))
    slots = queries.slots_of(seen, eyes, env, (cell, heading, goal))
    np.testing.assert_array_equal(slots[0], seen.cameras[0])
    np.testing.assert_array_equal(slots[4][2], eyes.table[index[2, 24, 2]])
    np.testing.assert_array_equal(slots[5][1], seen.maps[8, 11, 12])
    every = np.argwhere(answers != queries.UNASKED)[::7].T
    expected = classifier.predict(weights, queries.slots_of(seen, eyes, every[0], tuple(every[1:]))).argmax(
        axis=1
    )
    np.testing.assert_array_equal(answers[tuple(every)], expected)
    assert queries.agreement(weights, seen, eyes, answers, 0)["accuracy"] == 100


def test_right_answers_by_hand():
    obstacles = np.zeros((1, CELLS), bool)
    obstacles[0, 1] = True
    right = queries.right_answers(SimpleNamespace(layout=np.array([RING], np.uint8), obstacles=obstacles))
    np.testing.assert_array_equal(
        right[0, [0, 5, 2, 4], :, 2], [[DOWN] * 4, [DOWN] * 4, [STOP] * 4, [LEFT] * 4]
    )
    assert (right[0, 1] == queries.UNASKED).all()
    assert (right[0, :, :, [1, 12]] == queries.UNASKED).all()
    answers = np.full_like(right, DOWN)
    answers[0, 0] = queries.UNASKED
    downwards = int(np.sum(right[0, 1:] == DOWN))
    score = queries.answered_rightly(answers, right)
    assert (score["hits"], score["trials"]) == (downwards, np.sum(right[0, 1:] != queries.UNASKED))


def test_a_rollout_meets_the_answers_along_its_path():
    answers = np.full((1, CELLS, 4, CELLS), DOWN, np.int8)
    answers[0, 0, 3, 2] = RIGHT
    answers[0, 1, RIGHT - 1, 2] = RIGHT
    answers[0, 2, RIGHT - 1, 2] = STOP
    answers[0, 0, 3, 10] = LEFT  # off the grid
    met = queries.along_paths(answers, np.array([RING]), np.array([3]))
    assert {tuple(x) for x in np.argwhere(met[0, :, :, 2] != queries.UNASKED)} == {(0, 3), (1, 3), (2, 3)}
    assert met[0, 2, 3, 2] == STOP
    assert np.sum(met[0, :, :, 10] != queries.UNASKED) == 1
    assert (met[0, :, :, 12] == queries.UNASKED).all()  # a wall is no goal
    # To all other goals: right down the left lane.
    np.testing.assert_array_equal(
        np.argwhere(met[0, :, :, 20] == DOWN), [[0, 3], *([cell, DOWN - 1] for cell in (5, 10, 15, 20))]
    )


def test_what_answers_tell():
    train = np.array([[0, 1, -1], [0, 4, 2]], np.int8)
    test = np.array([[3, 4, 2]], np.int8)
    known = queries.known_of_answers(train, test)
    np.testing.assert_array_equal(known.train, [[1, 0, 0], [0, 1, 1]])
    np.testing.assert_array_equal(known.test.sum(), 2)
    both = known.beside(queries.Known(np.ones((2, 1), np.float32), np.zeros((1, 1), np.float32)))
    assert both.of(np.array([1]), np.array([0])).train.shape == (1, 4)


def test_obstacles_that_are_shown_are_found():
    truth = tuple((coins(seed, n * 15).reshape(n, 15) > 0) for seed, n in ((0, 3000), (1, 200)))
    shown = queries.Known(*(2 * known.astype(np.float32) - 1 for known in truth))
    found = queries.obstacles(shown, (truth[0], truth[1]), attack.Attacker(), 0)
    assert found["exact"]["hits"] == found["exact"]["trials"] == 200
    assert found["accuracy"] == found["balanced"] == found["auc"] == 100
    assert len(found["cells"]) == 15
    hidden = queries.Known(np.zeros((3000, 1), np.float32), np.zeros((200, 1), np.float32))
    assert queries.obstacles(hidden, (truth[0], truth[1]), attack.Attacker(), 0)["auc"] == 50


def test_the_area_under_the_curve():
    assert queries.area(np.array([0.1, 0.4, 0.4, 0.9]), np.array([False, True, False, True])) == 0.875


def test_properties_of_an_only_obstacle():
    obstacles = np.zeros((4, CELLS), bool)
    obstacles[[0, 1, 2, 3, 3], [1, 2, 3, 4, 5]] = True
    world = SimpleNamespace(
        obstacles=obstacles,
        obstacle_shape=np.array([[0, -1, -1], [2, -1, -1], [1, -1, -1], [0, 1, -1]], np.int8),
        obstacle_colour=np.array([[3, -1, -1], [1, -1, -1], [4, -1, -1], [0, 0, -1]], np.int8),
    )
    for name, envs, classes in (("shape", [0, 1, 2], [0, 2, 1]), ("colour", [0, 2], [3, 4])):
        found = queries.property_of_one(world, name)
        np.testing.assert_array_equal(found[0], envs)
        np.testing.assert_array_equal(found[1], classes)
