"""`worm3d learn`: what it refuses, and, where Stable-Baselines3 is installed, that it learns and writes a policy."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from control.learned.policy import Policy
from control.learned.senses import OWN
from control.tracking.paths import SCurve, offset
from scenes.learn.sampled import Sampled

HERE = importlib.util.find_spec("stable_baselines3") is not None
needs = pytest.mark.skipif(not HERE, reason="Stable-Baselines3 is not installed (extra 'learn')")


def test_a_sampled_path_is_the_path() -> None:
    path = SCurve(0.4, 4.0, 2.0, (0.5, 0.0), 0.1, "left")
    sampled, random = Sampled(path, 6.0, 1.0), np.random.default_rng(0)
    s = random.uniform(0.0, 6.0, 50)
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
    given = ("--minutes", "0.02", "--worms", "2", "--vary", "reference.radius_m=1:3", "-o", "run.duration_s=4")
    ended = worm3d("learn", "path_circle", "--to", "policy.npz", *given)
    assert ended.code == 0, ended.complaints
    policy = Policy.load(tmp_path / "policy.npz")
    assert policy.inputs == OWN + 2
    assert policy.about["steps"] >= 0
    assert policy.about["vary"] == {"reference.radius_m": "1:3"}
    ended = worm3d("learn", "path_circle", "--to", "b.npz", "--minutes", "0")
    assert (ended.code, len(ended.complaints)) == (2, 1)
