"""`worm3d learn`: what it refuses, and, where Stable-Baselines3 is installed, that it learns and writes a policy."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import worm3d
from control.identification import identified
from control.learned.policy import Policy
from control.learned.senses import BASE_OBSERVATION_SIZE
from control.tracking.paths import SCurve, offset
from scenes.models.loading import load_scene
from scenes.studies.learn.episode import Episode, Terms, reward_of
from scenes.studies.learn.practice import DRAWN, Practice
from scenes.studies.learn.sampled import Sampled

HERE = importlib.util.find_spec("stable_baselines3") is not None
needs = pytest.mark.skipif(not HERE, reason="Stable-Baselines3 is not installed (extra 'learn')")


def test_a_sampled_path_is_the_path() -> None:
    path = SCurve(0.4, 4.0, 2.0, (0.5, 0.0), 0.1, "left")
    sampled, random = Sampled(path, 6.0, 1.0), np.random.default_rng(0)
    s = random.uniform(0.0, 6.0, 20)
    np.testing.assert_allclose(sampled.point(s), path.point(s), atol=2e-5)
    np.testing.assert_allclose(sampled.heading(s), path.heading(s), atol=5e-5)
    np.testing.assert_allclose(sampled.curvature(s), path.curvature(s), atol=1e-3)
    for each in s:
        place = path.point(each) + random.normal(size=2) * 0.05
        one, two = float(path.project(place, each)), float(sampled.project(place, each))
        assert two == pytest.approx(one, abs=2e-3)
        assert offset(sampled, place, two) == pytest.approx(offset(path, place, one), abs=5e-5)


def test_mistakes_are_told(worm3d, tmp_path: Path) -> None:
    ended = worm3d("learn", "path_line", "--to", "policy.txt")
    assert (ended.code, ended.complaints) == (2, ["--to: got 'policy.txt', must be a file ending in .npz"])
    (tmp_path / "there.npz").write_text("")
    assert worm3d("learn", "path_line", "--to", "there.npz").code == 2
    if not HERE:
        ended = worm3d("learn", "path_line", "--to", "policy.npz")
        assert (ended.code, ended.complaints) == (
            4,
            ["worm3d learn needs Stable-Baselines3: pip install 'worm3d[learn]'"],
        )


@needs
@pytest.mark.filterwarnings("default")  # those of PyTorch are not ours
def test_a_short_training_gives_a_policy_and_its_curve(worm3d, tmp_path: Path) -> None:
    given = (
        "--minutes",
        "0.01",
        "--practice",
        "0.01",
        "--worms",
        "2",
        "--vary",
        "reference.radius_m=1:3",
        "-o",
        "run.duration_s=4",
    )
    ended = worm3d("learn", "path_circle", "--to", "policy.npz", *given)
    assert ended.code == 0, ended.complaints
    policy = Policy.load(tmp_path / "policy.npz")
    assert policy.inputs == BASE_OBSERVATION_SIZE + 2
    assert [stage["steps"] > 0 for stage in policy.about["stages"]] == [True, True]
    assert policy.about["vary"] == {"reference.radius_m": "1:3"}
    ended = worm3d("learn", "path_circle", "--to", "b.npz", "--minutes", "0")
    assert (ended.code, len(ended.complaints)) == (2, 1)


def practice(monkeypatch: pytest.MonkeyPatch, **values: float) -> Practice:
    """One worm in the reduced model, its draws fixed: without noise, errors and lags that are not known."""
    ideal = dict.fromkeys(DRAWN, 0.0) | {"speed": 0.08, "wavelength": 4.0, "speed_gain": 1.0, "turn_gain": 1.0}
    for name, value in (ideal | {"lag": 1.0} | values).items():
        monkeypatch.setitem(DRAWN, name, (value, value))
    monkeypatch.setattr("scenes.studies.learn.practice.STRAIGHT_SHARE", 0.0)
    monkeypatch.setattr("scenes.studies.learn.practice.ON_PATH_SHARE", 0.0)
    found = identified.load(worm3d.Worm())
    assert found is not None
    worms = Practice(1, found, 1.0, "hinge", 0.2)
    worms.reset(seed=0)
    worms._age[:] = 0.0
    return worms


def test_in_practice_a_worm_leaves_a_line_by_its_heading(monkeypatch: pytest.MonkeyPatch) -> None:
    worms = practice(monkeypatch, heading=0.1, crab=0.05, speed_gain=0.9)
    for _ in range(40):
        seen, rewards, *_ = worms.step(np.zeros((1, 2)))
    s, e, theta, v, *_ = worms._state[:, 0]
    assert (theta, v) == (pytest.approx(0.1), pytest.approx(0.9 * 0.08, rel=1e-3))
    assert e == pytest.approx(s * np.tan(0.15), rel=1e-9)
    half_a_wave = 0.072 * 0.5 / 0.8
    np.testing.assert_allclose(
        seen[0, 2:5], [0.9 * np.cos(0.15) - 1.0, 10.0 * (e - half_a_wave * np.sin(0.15)), np.sin(0.15)], atol=0.02
    )
    assert rewards[0] == pytest.approx(reward_of(seen[0, 3] / 10.0, seen[0, 2]), abs=1e-5)


def test_in_practice_the_map_turns_as_the_path_does(monkeypatch: pytest.MonkeyPatch) -> None:
    worms = practice(monkeypatch, bend=0.5)
    for _ in range(100):
        seen, *_ = worms.step(np.zeros((1, 2)))
    _, e, theta, v, w, _ = worms._state[:, 0]
    assert w == pytest.approx(0.5 * 0.08, rel=1e-3)
    along = v * np.cos(theta) / (1.0 - 0.5 * e)
    assert along * 0.5 == pytest.approx(w + 0.5 * (along - 0.08), abs=1e-4)
    np.testing.assert_allclose(seen[0, 6:10], 0.5)
    turned = practice(monkeypatch, bend=0.5)
    for _ in range(20):
        turned.step(np.array([[0.0, 0.2]]))
    assert turned._state[1, 0] > worms._state[1, 0] + 0.02, "an action to the left leads to the left"


def test_practice_is_like_the_plant(monkeypatch: pytest.MonkeyPatch) -> None:
    """By one law, both leave and join a line 0.1 body lengths off in about the same way."""
    worms = practice(monkeypatch, aside=0.1)
    scene = load_scene("path_line", ("run.duration_s=12", "sensor.com_noise_m=0", "reference.start_m=[0.5,-0.1]"))
    episode, asides = Episode(scene.settings, Terms(), 0), []
    seen = [worms._observed()[0], episode.observed()]
    for _ in range(60):
        actions = [np.clip([-0.8 * each[2], -0.3 * each[3] - 1.2 * each[4]], -1.0, 1.0) for each in seen]
        *_, facts = episode.crawl(actions[1])
        seen = [worms.step(actions[0][None])[0][0], episode.observed()]
        asides.append((seen[0][3] / 10.0, facts["offset_m"]))
    reduced, plant = np.array(asides).T
    assert plant[0] == pytest.approx(0.1, abs=2e-3)
    assert np.abs(plant[-15:]).max() < 0.03
    assert np.abs(reduced - plant).max() < 0.02
