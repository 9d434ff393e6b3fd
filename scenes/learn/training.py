"""Training of a policy by proximal policy optimisation (PPO) of Stable-Baselines3, on many worms at once.

Needs the optional part `learn` (pip install 'worm3d[learn]'), PyTorch among it; what comes out needs numpy only.

PPO: Schulman et al., Proximal policy optimization algorithms, arXiv:1707.06347. Of its settings these differ from the
library's: a discount whose horizon is some five waves, within which an action shows; small networks, since what is seen
is small; noise of the actions that begins at a fifth of their range; and a rate of learning that falls to a tenth.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter, process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from control.learned.policy import Policy
from scenes.gym_env import WormVectorEnv
from scenes.language.errors import MissingPartError
from worm3d.values import arguments

try:
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as error:
    raise MissingPartError("worm3d learn needs Stable-Baselines3: pip install 'worm3d[learn]'") from error

DISCOUNT = 0.97
"""Discount of a control period; rewards are scaled by 1 - DISCOUNT, so that values are of the size of a reward."""
HIDDEN: dict[str, list[int]] = {"pi": [], "vf": [32, 32]}
"""Widths of the hidden layers of the policy, which is linear, and of the value."""
PERIODS = 32
"""Control periods of each worm between two updates."""
BATCH = 256
"""Samples of a step of the optimiser."""
NOISE = -1.5
"""Logarithm of the noise of the actions at first."""
RATES = (3e-3, 3e-4)
"""Rates of learning at first and at last."""


@dataclass(frozen=True)
class Point:
    """State of the training after an update."""

    steps: int
    """Control periods so far, of all worms."""
    seconds: float
    """Wall time so far [s]."""
    reward: float
    """Mean reward of a control period since the update before."""


@dataclass(frozen=True, eq=False)
class Task:
    """What is trained, and for how long."""

    scene: str
    minutes: float
    """Wall time."""
    seed: int = 0
    overrides: Sequence[str] = ()
    vary: Mapping[str, str] = field(default_factory=dict)
    worms: int = 16
    threads: int = 1
    acts: str = "course"

    def __post_init__(self) -> None:
        arguments.number("minutes", self.minutes, "min", gt=0.0)
        arguments.whole("seed", self.seed, ge=0)


def train(task: Task, watch: Callable[[Point], bool] = lambda point: True) -> Policy:
    """Return a trained policy.

    Parameters
    ----------
    task : Task
    watch : callable
        Called after every update; returning False ends the training.

    Raises
    ------
    SceneError
        The scene is wrong, or its worm has not been identified, or a key cannot be varied.
    ValueError
        A length of time that is not above 0, or a seed below 0.
    """
    envs = WormVectorEnv(task.worms, task.scene, task.overrides, acts=task.acts, vary=task.vary, threads=task.threads)
    torch.set_num_threads(1)  # faster for networks this small
    clock = _Clock(60.0 * task.minutes, watch)
    ppo = PPO(
        "MlpPolicy",
        _Worms(envs, task.seed),
        learning_rate=lambda _: RATES[0] + (RATES[1] - RATES[0]) * clock.share,
        n_steps=PERIODS,
        batch_size=min(BATCH, task.worms * PERIODS),
        gamma=DISCOUNT,
        policy_kwargs={"net_arch": HIDDEN, "log_std_init": NOISE},
        seed=task.seed,
        device="cpu",
    )
    try:
        ppo.learn(10**12, callback=clock)
    except KeyboardInterrupt:
        clock.interrupted = True
    finally:
        envs.close()
    return Policy(_layers(ppo), _about(task, clock))


class _Clock(BaseCallback):
    """Ends the training in time, and keeps its curve."""

    def __init__(self, seconds: float, watch: Callable[[Point], bool]) -> None:
        super().__init__()
        self._seconds, self._watch = seconds, watch
        self._began, self._cpu = perf_counter(), process_time()
        self._rewards: list[float] = []
        self.points: list[Point] = []
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
        """Share of the time that is over."""
        return min(1.0, self.elapsed / self._seconds)

    def _on_step(self) -> bool:
        self._rewards.append(float(np.mean(self.locals["rewards"])) / (1.0 - DISCOUNT))
        return self.elapsed < self._seconds and not self.interrupted

    def _on_rollout_end(self) -> None:
        self.points.append(Point(self.num_timesteps, self.elapsed, float(np.mean(self._rewards))))
        self._rewards.clear()
        self.interrupted = not self._watch(self.points[-1])


class _Worms(VecEnv):
    """`WormVectorEnv` as Stable-Baselines3 has it, with scaled rewards."""

    def __init__(self, envs: WormVectorEnv, seed: int) -> None:
        self._envs, self._first = envs, seed * 1000
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

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
        self._envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self._envs, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise NotImplementedError(attr_name)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        raise NotImplementedError(method_name)

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        return [False] * self.num_envs


def _layers(ppo: PPO) -> tuple[tuple[NDArray[np.float64], NDArray[np.float64]], ...]:
    """Return the layers of the mean action."""
    actor = ppo.policy
    linear = [each for each in actor.mlp_extractor.policy_net if isinstance(each, torch.nn.Linear)]
    return tuple(
        tuple(part.detach().numpy().astype(np.float64) for part in (each.weight, each.bias))
        for each in (*linear, actor.action_net)
    )


def _about(task: Task, clock: _Clock) -> dict[str, Any]:
    """Return how a policy was trained."""
    points = clock.points
    kept = points[:: max(1, len(points) // 50)] + points[-1:]
    return {
        "method": "PPO of Stable-Baselines3",
        "acts": task.acts,
        "scene": task.scene,
        "overrides": list(task.overrides),
        "vary": dict(task.vary),
        "seed": task.seed,
        "worms": task.worms,
        "steps": points[-1].steps if points else 0,
        "wall_s": round(clock.elapsed, 1),
        "cpu_s": round(clock.cpu, 1),
        "curve": [[point.steps, round(point.seconds, 1), round(point.reward, 4)] for point in kept],
    }
