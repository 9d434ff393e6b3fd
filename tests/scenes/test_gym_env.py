"""The environment for agents passes Gymnasium's own checker, and rewards what it says."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

pytest.importorskip("gymnasium", reason="Gymnasium is not installed (extra 'gym')")

from gymnasium.utils.env_checker import check_env

from control.sensing.sensors import Measurement, Sensors
from scenes.gym_env import WormEnv
from scenes.language.errors import SceneError
from worm3d import Observation

STRAIGHT = np.array([0.29, -0.2, 0.0], dtype=np.float32)
"""About 0.08 m/s."""


def test_it_passes_the_checker() -> None:
    check_env(WormEnv("path_circle", ("run.duration_s=2",)), skip_render_check=True)


def test_an_episode_lasts_as_long_as_the_scene_and_pays_for_keeping_to_the_reference() -> None:
    env = WormEnv("path_line", ("run.duration_s=10",))
    env.reset(seed=1)
    rewards, ends = [], []
    for _ in range(50):
        _, reward, terminated, truncated, info = env.step(STRAIGHT)
        rewards.append(reward)
        ends.append(truncated)
        assert not terminated
        assert info["offset_m"] == pytest.approx(0.0, abs=1e-6)
    assert ends == [False] * 49 + [True]
    assert np.mean(rewards[25:]) > 0.8


def test_leaving_the_path_and_creeping_along_it_pay_less_than_keeping_to_it() -> None:
    def earned(action: np.ndarray) -> float:
        env = WormEnv("path_circle", ("run.duration_s=12",))
        env.reset(seed=0)
        return sum(env.step(action)[1] for _ in range(60))

    turning = np.array([0.29, -0.2, 0.3], dtype=np.float32)
    assert earned(turning) > earned(STRAIGHT) + 5.0
    assert earned(turning) > earned(np.array([-1.0, -1.0, 0.3], dtype=np.float32)) + 5.0


def test_seeds_are_noise_and_nothing_else() -> None:
    env = WormEnv("path_line", ("run.duration_s=2",))
    seen = []
    for seed in (3, 3, 4):
        first, _ = env.reset(seed=seed)
        seen.append(np.array([first, *(env.step(STRAIGHT)[0] for _ in range(5))]))
    assert_array_equal(seen[0], seen[1])
    assert np.abs(seen[0] - seen[2])[:, :12].max() > 0.005
    assert_allclose(seen[0][:, 12:14], seen[2][:, 12:14])


def test_the_left_is_to_the_left() -> None:
    env = WormEnv("path_line", ("run.duration_s=12", "sensor.com_noise_m=0"))
    env.reset(seed=0)
    for _ in range(60):
        seen, *_, info = env.step(np.array([0.3, 0.0, 0.5], dtype=np.float32))
    assert info["offset_m"] > 0.05
    assert seen[14] == pytest.approx(info["offset_m"], abs=0.01)


def test_other_scenes_are_refused() -> None:
    with pytest.raises(SceneError, match="flat: a scene of the model 'worm', must be of 'worm_control'"):
        WormEnv("flat")
    with pytest.raises(ValueError, match=r"control_period: got 0.001 s, must be at least 0.01 s"):
        WormEnv("path_line", control_period=0.001)


def test_samples_that_cannot_be_are_not_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    env = WormEnv("path_line", ("run.duration_s=4",))
    env.reset(seed=1)
    look = Sensors.__call__

    def spoilt(sensors: Sensors, seen: Observation) -> Measurement:
        measured = look(sensors, seen)
        assert measured.strain is not None
        measured.strain[1, 0] = np.nan
        return measured if measured.com is None else measured.changed(com=(np.full(3, np.inf), measured.com_time))

    monkeypatch.setattr(Sensors, "__call__", spoilt)
    for _ in range(5):
        observed, reward, *_, info = env.step(STRAIGHT)
        assert np.isfinite(observed).all()
        assert np.isfinite(reward)
    assert info["measurements_refused"] == 100 + 19, "strains at each step, and places 20 times a second"
