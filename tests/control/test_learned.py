"""The learned controller: what it senses, its network, and that it sees in a run what it saw in training."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from control.gaits.steering import GaitParameters
from control.identification import identified
from control.learned.acts import ACTS, TRIM, TURN
from control.learned.controller import LearnedPolicy
from control.learned.course import Course
from control.learned.policy import Policy
from control.learned.senses import BASE_OBSERVATION_SIZE, CURVATURE, SPEED, Senses
from control.sensing.sensors import Channel, Measurement, Sensors
from control.task import ControlTask
from control.tracking.paths import Circle, Line
from control.tracking.references import Constant, Reference
from scenes.models.loading import load_scene
from scenes.studies.learn.episode import Episode, Terms

WORM = worm3d.Worm()
FOUND = identified.load(WORM)
assert FOUND is not None
LINE = Reference(Constant(0.08), path=Line())


def policy(actions: int = 2, inputs: int = BASE_OBSERVATION_SIZE + 2, **about: object) -> Policy:
    """A network with random weights, which steers against its offset."""
    random = np.random.default_rng(2)
    hidden = random.normal(size=(8, inputs)) * 0.2, random.normal(size=8) * 0.1
    return Policy((hidden, (random.normal(size=(actions, 8)) * 0.2, np.zeros(actions))), about)


def went(course: Course, until: float, noise: float = 0.0, seed: int = 0) -> None:
    """A worm that rocks at 0.8 Hz while it goes on at (0.08, 0.01) m/s, seen 40 times a second."""
    random = np.random.default_rng(seed)
    for t in np.arange(0.0, until + 1e-9, 0.025):
        rocking = np.array([0.01, -0.004]) * np.sin(2.0 * np.pi * 0.8 * t + 0.3)
        course.add(0.8 * t, t, np.array([0.08, 0.01]) * t + rocking + noise * random.normal(size=2))


def test_rocking_leaves_nothing_in_means_over_a_wave() -> None:
    course = Course()
    went(course, 5.0)
    motion = course.motion()
    assert motion is not None
    assert_allclose(motion.velocity, (0.08, 0.01), atol=1e-9)
    assert_allclose(motion.place, np.array([0.08, 0.01]) * (5.0 - 0.5 / 0.8), atol=1e-9)
    assert motion.wave == pytest.approx(1.25)


def test_noise_is_averaged_as_it_says() -> None:
    found = []
    for seed in range(300):
        course = Course()
        went(course, 2.5, 0.005, seed)
        motion = course.motion()
        assert motion is not None
        assert motion.velocity is not None
        found.append([*(motion.place - [0.15, 0.01875]), *(motion.velocity - [0.08, 0.01]) * 0.5 * motion.wave])
    place, _, way, _ = np.std(found, axis=0)
    assert place == pytest.approx(0.005 / np.sqrt(50), rel=0.12)
    assert way == pytest.approx(0.005 / np.sqrt(50), rel=0.12)


def test_before_a_wave_and_a_half_there_is_a_place_only() -> None:
    course = Course()
    assert course.motion() is None
    went(course, 1.5)
    motion = course.motion()
    assert motion is not None
    assert motion.velocity is None
    course.add(0.1, 9.0, np.full(2, 100.0))  # the phase went back: not taken
    assert_array_equal(course.motion().place, motion.place)


def senses_along(reference: Reference, place: np.ndarray, azimuth: float) -> np.ndarray:
    """What is seen by a worm that goes straight to a place at 0.1 m/s."""
    senses = Senses(WORM, reference, 2)
    forward = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    for t in np.arange(0.0, 4.0 + 1e-9, 0.05):
        com = np.append(place, 0.0) + 0.1 * (t - 4.0 + 0.5) * forward  # at 1 Hz the mean is of half a wave ago
        senses.take(t, Measurement(t, com=(com, t)), GaitParameters(0.2, 1.0), 2.0 * np.pi * t)
    return senses.observed(4.0)


def test_what_is_seen_is_where_the_worm_is_beside_its_path() -> None:
    seen = senses_along(LINE, np.array([1.0, 0.05]), 0.2)
    assert_allclose(
        seen[:6], [1.0, 0.8, 0.1 * np.cos(0.2) / 0.08 - 1.0, 0.5, np.sin(0.2), np.cos(0.2) - 1.0], atol=1e-9
    )
    circle = Reference(Constant(0.08), path=Circle(0.8, (0.0, -0.8)))
    seen = senses_along(circle, np.array([0.0, -0.8 + 0.03]), 0.0)
    assert seen[3] == pytest.approx(0.3, abs=1e-9)
    assert_allclose(seen[CURVATURE : CURVATURE + 4], 1.25)


def test_mirrored_worlds_look_mirrored() -> None:
    left = senses_along(Reference(Constant(0.08), path=Circle(0.8)), np.array([0.3, 0.1]), 0.4)
    right = senses_along(Reference(Constant(0.08), path=Circle(0.8, towards="right")), np.array([0.3, -0.1]), -0.4)
    odd = [3, 4, *range(CURVATURE, CURVATURE + 4), 10]
    signs = np.ones(len(left))
    signs[odd] = -1.0
    assert_allclose(left, signs * right, atol=1e-12)


def test_no_action_is_the_wave_of_the_map() -> None:
    found = FOUND.maps["hinge"]
    act, seen = ACTS["course"](found, "hinge", 1.0), np.zeros(BASE_OBSERVATION_SIZE + 2)
    seen[[SPEED, CURVATURE]] = 0.8, 0.5
    plain = act(np.zeros(2), seen)
    assert_allclose(plain.row(), found_wave(0.08, 0.04))
    changed = act(np.array([0.2, -0.1]), seen)
    assert_allclose(changed.row(), found_wave(0.08 * (1.0 + 0.2 * TRIM), 0.08 * (0.5 - 0.1 * TURN)))


def found_wave(speed: float, turn_rate: float) -> np.ndarray:
    act = ACTS["course"](FOUND.maps["hinge"], "hinge", 1.0)
    amplitude, frequency, steering = act.feed_forward(speed, turn_rate)
    return np.array([amplitude, frequency, 0.0, steering])


def test_a_policy_comes_back_from_its_file(tmp_path: Path) -> None:
    one, seen = policy(acts="course", seed=3), np.random.default_rng(0).normal(size=BASE_OBSERVATION_SIZE + 2)
    one.save(tmp_path / "a.npz")
    two = Policy.load(tmp_path / "a.npz")
    assert_array_equal(one(seen), two(seen))
    assert two.about == {"acts": "course", "seed": 3}
    (weights, offsets), (last, zero) = one.layers
    assert_allclose(one(seen), np.clip(last @ np.tanh(weights @ seen + offsets) + zero, -1.0, 1.0))
    assert (np.abs(one(1e6 * seen)) <= 1.0).all()


def test_files_and_networks_that_are_none_are_refused(tmp_path: Path) -> None:
    (tmp_path / "text.npz").write_text("text")
    with pytest.raises(ValueError, match="is no policy of 'worm3d learn'"):
        Policy.load(tmp_path / "text.npz")
    with pytest.raises(ValueError, match=r"none\.npz: cannot be read"):
        Policy.load(tmp_path / "none.npz")
    with pytest.raises(ValueError, match="acts: got 'force', must be one of course, wave"):
        policy(acts="force")
    with pytest.raises(ValueError, match="got 15 inputs and 3 outputs, must be 15 inputs or more, and 2 outputs"):
        policy(3)
    with pytest.raises(ValueError, match="not finite"):
        Policy(((np.full((2, BASE_OBSERVATION_SIZE + 2), np.nan), np.zeros(2)),))


def test_in_a_run_it_sees_and_does_what_it_does_in_training() -> None:
    scene = load_scene("path_circle", ("run.duration_s=6", "seed=5", "controller.mechanism=hinge")).settings
    net = policy()
    episode, steps = Episode(scene, Terms(), 5), []
    over = False
    while not over:
        seen = episode.observed()
        steps.append(seen)
        _, _, over, _ = episode.crawl(net(seen))
    sensors = Sensors(strain=None, com=Channel(noise=0.005, rate=20.0), seed=5)
    path = Circle(1.5, (0.5, 0.0), 0.0, "left")
    controller = LearnedPolicy(ControlTask(WORM, Reference(Constant(0.08), path=path), FOUND), net)
    result = worm3d.simulate(WORM, worm3d.Plane(), actuation=controller, sensor=sensors, duration=6.0)
    decided = np.array([decision.parameters.row() for decision in controller.decisions])
    act = ACTS["course"](FOUND.maps["hinge"], "hinge", 1.0)
    assert len(decided) == len(steps) == 30
    assert_allclose(decided, [act(net(seen), seen).row() for seen in steps], rtol=1e-6)
    assert not result.status.diverged
    assert {decision.source for decision in controller.decisions} == {"own"}


def test_it_rests_where_no_speed_is_asked_for() -> None:
    controller = LearnedPolicy(ControlTask(WORM, Reference(Constant(0.0), path=Line()), FOUND), policy())
    controller.step(0.0, Measurement(0.0, com=(np.zeros(3), 0.0)))
    assert controller.decisions[0].parameters.amplitude == 0.0


def test_the_shipped_policy_joins_a_line_at_the_speed_that_is_asked_for() -> None:
    controller = LearnedPolicy(ControlTask(WORM, Reference(Constant(0.08), path=Line((0.5, -0.1))), FOUND))
    result = worm3d.simulate(
        WORM, worm3d.Plane(), actuation=controller, sensor=Sensors(seed=10), duration=24.0, dt=0.02
    )
    course = Course()
    for t, place in zip(result.time, result.com, strict=True):
        course.add(0.8 * t, t, place[:2])
    motion = course.motion()
    assert motion is not None
    assert motion.velocity is not None
    assert motion.place[1] == pytest.approx(-0.1, abs=0.02)
    assert motion.velocity[0] == pytest.approx(0.08, rel=0.1)
    assert controller.failures == 0
