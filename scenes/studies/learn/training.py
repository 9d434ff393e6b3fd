"""Training of a policy on many worms at once, by proximal policy optimisation (PPO) of Stable-Baselines3.

Training needs the optional part `learn` (pip install 'worm3d[learn]'), which includes PyTorch. The trained policy needs
only numpy. PPO is described in Schulman et al., Proximal policy optimization algorithms, arXiv:1707.06347.

Some settings differ from the defaults of the library. The discount has a horizon of about five waves, because an action
affects the motion within this time. The networks are small, because the observation has few numbers. The noise of the
actions begins at a fifth of their range. The learning rate decreases during the training.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter, process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from control.learned.policy import Policy
from scenes.language.errors import MissingPartError
from scenes.studies.learn.practice import Practice
from scenes.studies.learn.task import Task

try:
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import VecEnv

    from scenes.studies.learn.environment import (
        WormVectorEnv,  # last, so that this import fails only if Stable-Baselines3 is missing
    )
except ImportError as error:
    raise MissingPartError("worm3d learn needs Stable-Baselines3: pip install 'worm3d[learn]'") from error

DISCOUNT = 0.97
"""Discount factor per control period. Rewards are multiplied by 1 - DISCOUNT, so that the discounted sum of rewards is
about as large as a single unscaled reward."""
PERIODS_PER_UPDATE = 32
"""Number of control periods of each worm between two updates of the policy."""
RATES, LATER_RATES = (1e-3, 1e-4), (2e-4, 5e-5)
"""Learning rates at the beginning and at the end of a stage. `LATER_RATES` are used in the stage that follows
practice."""


@dataclass(frozen=True)
class Point:
    """State of the training after an update."""

    steps: int
    """Number of control periods so far, summed over all worms."""
    seconds: float
    """Wall time so far [s]."""
    reward: float
    """Mean reward per control period since the previous update."""


def train(task: Task, watch: Callable[[Point], None]) -> Policy:
    """Train a policy and return it.

    Parameters
    ----------
    task : Task
    watch : callable
        Called after every update.

    Raises
    ------
    SceneError
        The scene is wrong, or its worm has not been identified, or a key cannot be varied.
    ValueError
        `acts` is unknown, or the number of worms or threads is below 1.
    """
    envs = WormVectorEnv(task.worms, task.scene, task.overrides, acts=task.acts, vary=task.vary, threads=task.threads)
    torch.set_num_threads(1)  # faster for networks this small
    stages: list[tuple[WormVectorEnv | Practice, float, tuple[float, float]]] = [(envs, task.minutes, RATES)]
    began = None
    if task.practice > 0.0:
        stages = [(envs.practice(), task.practice, RATES), (envs, task.minutes, LATER_RATES)]
    clocks = []
    for worms, minutes, rates in stages:
        clock = _Clock(60.0 * minutes, watch)
        ppo = _ppo(_Worms(worms, envs, task.seed), rates, clock, task.seed)
        if began is not None:
            ppo.policy.load_state_dict(began)
        try:
            ppo.learn(10**12, callback=clock)
        except KeyboardInterrupt:
            clock.interrupted = True
        clock.lasted = clock.elapsed, clock.cpu
        began = ppo.policy.state_dict()
        clocks.append(clock)
        if clock.interrupted:
            break
    envs.close()
    return Policy(_layers(ppo), _about(task, clocks))


def _ppo(worms: _Worms, rates: tuple[float, float], clock: _Clock, seed: int) -> PPO:
    return PPO(
        "MlpPolicy",
        worms,
        learning_rate=lambda _: rates[0] + (rates[1] - rates[0]) * clock.share,
        n_steps=PERIODS_PER_UPDATE,
        batch_size=min(256, worms.num_envs * PERIODS_PER_UPDATE),
        gamma=DISCOUNT,
        policy_kwargs={"net_arch": [32, 32], "log_std_init": -1.5},
        seed=seed,
        device="cpu",
    )


class _Clock(BaseCallback):
    """Ends the training after a given time, and records the learning curve."""

    def __init__(self, seconds: float, watch: Callable[[Point], None]) -> None:
        super().__init__()
        self._seconds, self._watch = seconds, watch
        self._began, self._cpu = perf_counter(), process_time()
        self._rewards: list[float] = []
        self.points: list[Point] = []
        self.lasted = 0.0, 0.0
        """Total wall time and processor time [s]."""
        self.interrupted = False

    @property
    def elapsed(self) -> float:
        """Wall time so far [s]."""
        return perf_counter() - self._began

    @property
    def cpu(self) -> float:
        """Processor time so far [s]."""
        return process_time() - self._cpu

    @property
    def share(self) -> float:
        """Elapsed fraction of the allowed time."""
        return min(1.0, self.elapsed / self._seconds)

    def _on_step(self) -> bool:
        self._rewards.append(float(np.mean(self.locals["rewards"])) / (1.0 - DISCOUNT))
        return self.elapsed < self._seconds

    def _on_rollout_end(self) -> None:
        self.points.append(Point(self.num_timesteps, self.elapsed, float(np.mean(self._rewards))))
        self._rewards.clear()
        self._watch(self.points[-1])


class _Worms(VecEnv):
    """`WormVectorEnv` with the interface of Stable-Baselines3 and scaled rewards."""

    def __init__(self, worms: WormVectorEnv | Practice, envs: WormVectorEnv, seed: int) -> None:
        self._envs, self._first = worms, seed * 1000
        super().__init__(worms.num_envs, envs.single_observation_space, envs.single_action_space)

    def reset(self) -> NDArray[np.float32]:
        return self._envs.reset(seed=self._first)[0]

    def step_async(self, actions: NDArray[np.float32]) -> None:
        self._actions = actions

    def step_wait(self) -> tuple[Any, ...]:
        seen, rewards, terminated, truncated, info = self._envs.step(self._actions)
        ended = terminated | truncated
        told: list[dict[str, Any]] = [{} for _ in ended]
        for k in np.flatnonzero(ended):
            told[k] = {"terminal_observation": info["final_obs"][k], "TimeLimit.truncated": bool(truncated[k])}
        return seen, (1.0 - DISCOUNT) * rewards, ended, told

    def close(self) -> None:
        """Do nothing, because `train` closes the worms."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self._envs, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise NotImplementedError(attr_name)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        raise NotImplementedError(method_name)

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        return [False] * self.num_envs


def _layers(ppo: PPO) -> tuple[tuple[NDArray[np.float64], NDArray[np.float64]], ...]:
    """Return the weights and biases of the network that computes the mean action, layer by layer."""
    actor = ppo.policy
    linear = [each for each in actor.mlp_extractor.policy_net if isinstance(each, torch.nn.Linear)]
    return tuple(
        tuple(part.detach().numpy().astype(np.float64) for part in (each.weight, each.bias))
        for each in (*linear, actor.action_net)
    )


def _about(task: Task, clocks: Sequence[_Clock]) -> dict[str, Any]:
    """Return the record of the training: its settings, and duration and learning curve of each stage."""
    stages = [
        {
            "steps": clock.num_timesteps,
            "wall_s": round(clock.lasted[0], 1),
            "cpu_s": round(clock.lasted[1], 1),
            "curve": [[each.steps, round(each.seconds, 1), round(each.reward, 4)] for each in _thinned(clock.points)],
        }
        for clock in clocks
    ]
    given = {name: getattr(task, name) for name in ("acts", "scene", "overrides", "vary", "seed", "worms")}
    return {"method": "PPO of Stable-Baselines3", **given, "practice": task.practice > 0.0, "stages": stages}


def _thinned(points: Sequence[Point]) -> Sequence[Point]:
    """Return about thirty of the points, including the last point."""
    return [*points[: -1 : max(1, len(points) // 30)], *points[-1:]]
