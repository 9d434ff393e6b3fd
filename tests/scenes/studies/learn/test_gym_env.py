"""The environments for agents pass Gymnasium's own checker, and reward what they say."""

import threading
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

pytest.importorskip("gymnasium", reason="Gymnasium is not installed (extra 'gym')")

import gymnasium
from gymnasium.utils.env_checker import check_env

from control.learned.policy import POLICY_OF, Policy
from control.sensing.sensors import Measurement, Sensors
from scenes.gym_env import WormEnv, WormVectorEnv
from scenes.language.errors import SceneError
from scenes.studies.learn import environment
from scenes.studies.learn.named import NAMED
from worm3d import Observation

STRAIGHT = np.zeros(2, dtype=np.float32)
"""The wave of the map, straight ahead."""
NOISELESS = ("run.duration_s=12", "sensor.com_noise_m=0")
KNOWN, MISS, ASIDE, CURVATURE, STEERED, BEFORE = 0, 2, 3, 6, 12, slice(13, 15)


def test_it_passes_the_checker() -> None:
    check_env(WormEnv("path_circle", ("run.duration_s=2",)), skip_render_check=True)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name == "PathFollow-v0" else pytest.mark.slow) for name in NAMED]
)
def test_each_environment_has_a_name_and_passes_the_checker(name: str) -> None:
    env = gymnasium.make(f"worm3d/{name}", render_mode="rgb_array")
    check_env(env.unwrapped, skip_render_check=True)
    env.reset(seed=1)
    env.step(STRAIGHT)
    first = env.render()
    for _ in range(10):
        env.step(STRAIGHT)
    later = env.render()
    assert first.dtype == np.uint8
    assert later.shape == first.shape
    assert np.abs(later.astype(int) - first).max() > 100, "the worm has moved"
    env.close()


def test_each_environment_has_a_policy_that_was_trained_in_the_environment() -> None:
    assert {*POLICY_OF} == {f"worm3d/{name}" for name in NAMED}
    for name, task in NAMED.items():
        about = Policy.load(POLICY_OF[f"worm3d/{name}"]).about
        assert about["scene"] == task.scene
        if name != "PathFollow-v0":  # the policy of the controller `LearnedPolicy` saw other lateral frictions, too
            assert about["vary"] == task.vary
            assert about["overrides"] == [*task.overrides]


def test_episodes_of_a_named_environment_are_drawn() -> None:
    env = gymnasium.make("worm3d/Slope-v0")
    offsets = []
    for seed in (1, 2, 1):
        env.reset(seed=seed)
        for _ in range(20):
            *_, info = env.step(STRAIGHT)
        offsets.append(info["offset_m"])
    assert offsets[0] == offsets[2]
    assert abs(offsets[0] - offsets[1]) > 1e-4


def test_a_vector_of_named_environments_is_that_of_this_package() -> None:
    envs = gymnasium.make_vec("worm3d/Pipe-v0", num_envs=2, threads=2, render_mode="rgb_array")
    assert isinstance(envs.unwrapped, WormVectorEnv)
    envs.reset(seed=0)
    envs.step(np.zeros((2, 2), dtype=np.float32))
    pictures = envs.render()
    assert [each.shape for each in pictures] == [pictures[0].shape] * 2
    envs.close()


def test_unknown_render_modes_are_refused() -> None:
    with pytest.raises(ValueError, match="render_mode: got 'ansi', must be one of 'human', 'rgb_array'"):
        WormEnv("path_line", render_mode="ansi")


def test_a_browser_can_watch_an_episode(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    env = WormEnv("path_line", ("run.duration_s=1",), render_mode="human")
    env.reset(seed=0)
    for _ in range(2):
        env.step(STRAIGHT)
    assert env.render() is None
    env.close()
    assert "http://127.0.0.1:" in capsys.readouterr().out


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
    miss = info["speed_m_s"] / 0.08 - 1.0
    assert rewards[-1] == pytest.approx(1.0 - 0.5 * np.log1p((miss / 0.05) ** 2), abs=1e-6), "(LE1)"
    assert np.mean(rewards[25:]) > 0.8


def test_leaving_the_path_and_creeping_along_it_pay_less_than_keeping_to_it() -> None:
    def earned(action: np.ndarray) -> float:
        env = WormEnv("path_circle", ("run.duration_s=12",))
        env.reset(seed=0)
        return sum(env.step(action)[1] for _ in range(60))

    kept = earned(STRAIGHT)
    assert kept > earned(np.array([0.0, 0.2], dtype=np.float32)) + 5.0
    assert kept > earned(np.array([-1.0, 0.0], dtype=np.float32)) + 5.0


def test_seeds_are_noise_and_nothing_else() -> None:
    env = WormEnv("path_line", ("run.duration_s=2",), channels=("strain",))
    seen, way = [], []
    for seed in (3, 3, 4):
        first, _ = env.reset(seed=seed)
        steps = [env.step(STRAIGHT) for _ in range(5)]
        seen.append(np.array([first, *(step[0] for step in steps)]))
        way.append([step[4]["offset_m"] for step in steps])
    assert_array_equal(seen[0], seen[1])
    assert np.abs(seen[0] - seen[2])[:, 15:].max() > 0.005, "strains"
    assert np.abs(seen[0] - seen[2])[:, ASIDE].max() > 0.005
    assert_allclose(way[0], way[2], atol=1e-12)


def test_the_left_is_to_the_left() -> None:
    env = WormEnv("path_line", NOISELESS)
    env.reset(seed=0)
    for _ in range(60):
        seen, *_, info = env.step(np.array([0.1, 0.15], dtype=np.float32))
    assert info["offset_m"] > 0.05
    assert seen[KNOWN] == 1.0
    assert seen[ASIDE] == pytest.approx(10.0 * info["offset_m"], abs=1e-3)
    assert seen[STEERED] == pytest.approx(0.15, abs=1e-6)
    assert seen[MISS] == pytest.approx(info["speed_m_s"] / 0.08 - 1.0, abs=0.05)
    assert_allclose(seen[BEFORE], (0.1, 0.15), atol=1e-6)


def test_other_scenes_and_senses_are_refused() -> None:
    with pytest.raises(SceneError, match="flat: a scene of the model 'worm', must be of 'worm_control'"):
        WormEnv("flat")
    with pytest.raises(ValueError, match=r"control_period: got 0.001 s, must be at least 0.01 s"):
        WormEnv("path_line", control_period=0.001)
    with pytest.raises(ValueError, match=r"channels: got 'strian', must be among strain, com"):
        WormEnv("path_line", channels=("strian",))
    with pytest.raises(SceneError, match="channels: got 'heading', must be measured in the scene"):
        WormEnv("path_line", channels=("heading",))
    with pytest.raises(ValueError, match="acts: got 'force', must be one of 'course', 'wave'"):
        WormEnv("path_line", acts="force")


def test_actions_may_be_amplitude_frequency_and_steering() -> None:
    env = WormEnv("path_line", NOISELESS, acts="wave")
    assert env.action_space.shape == (3,)
    env.reset(seed=0)
    for _ in range(30):
        *_, info = env.step(np.array([0.29, -0.2, 0.4], dtype=np.float32))
    assert info["speed_m_s"] == pytest.approx(0.08, rel=0.1)
    assert info["offset_m"] > 0.01


def test_samples_that_cannot_be_are_not_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    env = WormEnv("path_line", ("run.duration_s=4",), channels=("strain",))
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
    assert info["measurements_refused"] == 100 + 20, "strains at each step, and places 20 times a second"


VARIED = {"reference.radius_m": "0.8:3", "reference.towards": "left,right"}


@pytest.mark.slow
def test_many_worms_are_those_of_single_environments_whatever_the_threads() -> None:
    actions = np.random.default_rng(5).uniform(-0.5, 0.5, (12, 3, 2)).astype(np.float32)
    many = [WormVectorEnv(3, "path_circle", ("run.duration_s=2",), vary=VARIED, threads=threads) for threads in (1, 2)]
    seen = [env.reset(seed=7)[0] for env in many]
    assert_array_equal(seen[0], seen[1])
    assert len({float(each) for each in seen[0][:, CURVATURE]}) == 3, "each in a scene of its own"
    ended = 0
    for action in actions:
        (first, rewards, _, over, info), (second, *_) = (env.step(action) for env in many)
        assert_array_equal(first, second)
        ended += int(over.sum())
        if over.any():
            assert rewards.shape == (3,)
            assert all(each.shape == (15,) for each in info["final_obs"])
            assert (first[:, KNOWN] == 0.0).all(), "the next episodes have begun"
    assert ended == 3
    single = WormEnv("path_circle", ("run.duration_s=2",), vary=VARIED)
    for k in range(3):
        single.reset(seed=7 + k)  # the generator of Gymnasium is numpy's default one
        assert_array_equal(single.step(actions[0][k])[0], _stepped(7 + k, actions[0][k]))
    for env in many:
        env.close()


def test_worms_are_made_in_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """CasADi, which worms need, has no threads."""
    made, make = [], environment._Worm.episode

    def episode(worm: Any, random: np.random.Generator) -> Any:
        made.append(threading.get_ident())
        return make(worm, random)

    monkeypatch.setattr(environment._Worm, "episode", episode)
    envs = WormVectorEnv(2, "path_circle", ("run.duration_s=0.4",), threads=2)
    envs.reset(seed=1)
    for _ in range(2):
        *_, over, _ = envs.step(np.zeros((2, 2), dtype=np.float32))
    envs.close()
    assert over.all()
    assert made == [threading.get_ident()] * 5


def _stepped(seed: int, action: np.ndarray) -> np.ndarray:
    env = WormVectorEnv(1, "path_circle", ("run.duration_s=2",), vary=VARIED)
    env.reset(seed=seed)
    seen = env.step(action[None])[0][0]
    env.close()
    return seen


def test_keys_that_cannot_be_varied_are_told_at_once() -> None:
    with pytest.raises(SceneError, match=r"reference\.radius_n"):
        WormVectorEnv(2, "path_circle", vary={"reference.radius_n": "1:2"})
    with pytest.raises(ValueError, match="num_envs: got 0"):
        WormVectorEnv(0)
