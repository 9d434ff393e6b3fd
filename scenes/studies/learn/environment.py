"""Environments of Gymnasium where an agent chooses the parameters of the wave of one worm, or of many worms.

    import scenes.gym_env  # registers the environments of `scenes.studies.learn.named`
    env = gymnasium.make("worm3d/PathFollow-v0")
    envs = gymnasium.make_vec("worm3d/Slope-v0", num_envs=16, threads=2)

    env = WormEnv("path_circle", control_period=0.2)
    envs = WormVectorEnv(8, "path_s_curve", vary={"reference.amplitude_m": "0.05:0.6", "sensor.com_noise_m": "0:0.01"})

The environments need the optional part `gym` (pip install 'worm3d[gym]').

A scene defines the task of the worm. An action has several numbers in [-1, 1] and holds for a control period. The
parameter `acts` selects the meaning of these numbers (`control.learned.acts`): corrections of the commanded speed and
turn rate ("course"), or amplitude, frequency and steering ("wave"). The agent observes the quantities of
`control.learned.senses`, which the scene's sensors measure with noise. The reward depends on the true motion; see (LE1)
of `scenes.studies.learn.episode`.

An episode ends after the duration of the scene (truncated), or when the run diverges (terminated). Measured values that
are impossible are discarded (`control.sensing.gate`), and `info["measurements_refused"]` counts them. In a vector
environment, a worm whose episode has ended begins the next episode in the same step (`AutoresetMode.SAME_STEP`), with
new random values of the varied keys.

With the render mode "rgb_array", `render` returns a picture of the worm from the side and from above. With "human", a
browser shows the worm in real time; the address of the page is printed if no browser can be opened.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from control.learned.acts import ACTS
from control.learned.senses import OBSERVATION_LIMIT, Senses
from scenes.language.errors import MissingPartError, SceneError
from scenes.language.toml import shown
from scenes.models.control.build import identified_of
from scenes.models.control.reference import reference_of
from scenes.models.control.schema import ControlScene
from scenes.models.loading import load_scene
from scenes.models.worm.build import worm_of
from scenes.studies.learn.episode import Episode, Terms
from scenes.studies.learn.named import NAMED, NAMESPACE
from scenes.studies.learn.practice import Practice
from scenes.studies.learn.seen import Page, Picture
from scenes.sweep.vary import design_of, is_drawn
from worm3d.values import arguments

try:
    import gymnasium
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space
except ImportError as error:
    raise MissingPartError("scenes.gym_env needs Gymnasium: pip install 'worm3d[gym]'") from error

Seen = NDArray[np.float32]
Info = dict[str, Any]


class _Worm:
    """Common part of both environments: the scene, its varied keys, and the spaces of actions and observations.

    Raises
    ------
    SceneError
        The scene is wrong, or has no reference, or its worm has not been identified, or a key cannot be varied.
    ValueError
        The control period is shorter than a time step, or `acts` or a channel is unknown.
    """

    def __init__(
        self, scene: str, overrides: Sequence[str], vary: Mapping[str, Any] | None, how: Terms, pictured: bool
    ) -> None:
        self._scene, self._overrides, self._vary, self._how = scene, tuple(overrides), dict(vary or {}), how
        self._pictured = pictured
        plain = self._settings(())
        self.episode(np.random.default_rng(0))
        actions = ACTS[how.acts].size
        size = Senses(worm_of(plain), reference_of(plain), actions, how.channels).size
        self.actions = gymnasium.spaces.Box(-1.0, 1.0, (actions,), np.float32)
        self.observations = gymnasium.spaces.Box(-OBSERVATION_LIMIT, OBSERVATION_LIMIT, (size,), np.float32)

    def episode(self, random: np.random.Generator) -> Episode:
        """Return a new episode with random measurement errors and random values of the varied keys."""
        seed, keys = int(random.integers(2**31)), []
        if self._vary:
            drawn = 1 if any(map(is_drawn, self._vary.values())) else None
            cases = list(design_of(self._scene, ControlScene, self._vary, random=drawn, seed=seed).cases())
            keys = [f"{key}={shown(value)}" for key, value in cases[int(random.integers(len(cases)))].items()]
        return Episode(self._settings(keys), self._how, seed, pictured=self._pictured)

    def practice(self, count: int) -> Practice:
        """Return `count` worms in the reduced model."""
        if self._how.acts != "course":
            raise ValueError(f"practice: got actions by {self._how.acts!r}, must be 'course'")
        scene = self._settings(())
        found = identified_of(scene)
        return Practice(count, found, worm_of(scene).length, scene.controller.mechanism, self._how.control_period)

    def _settings(self, more: Sequence[str]) -> ControlScene:
        asked = (*self._overrides, *more)
        settings = load_scene(self._scene, asked).settings
        if isinstance(settings, ControlScene) and settings.controller.kind == "mpc":
            # If the scene leaves out the steering mechanism or the form of the wave, the policy uses the defaults of
            # the controllers other than the MPC.
            settings = load_scene(self._scene, ("controller.kind=open_loop", *asked)).settings
        if not isinstance(settings, ControlScene):
            raise SceneError(f"{self._scene}: a scene of the model '{settings.model}', must be of 'worm_control'")
        return settings


class WormEnv(gymnasium.Env[Seen, Seen]):
    """A worm that follows the reference of a scene.

    Parameters
    ----------
    scene : str
        A name from `worm3d list`, or a file. The controller of the scene is not used.
    overrides : sequence of str
        Changes of the scene, each of the form `section.key=value`.
    control_period : float
        Time between two actions [s].
    acts : str
        Meaning of an action, "course" or "wave".
    channels : sequence of str
        Further channels of the sensors that the agent observes, such as "strain".
    vary : mapping, optional
        Keys of the scene that have a random value in each episode. The value for a key is a range "lo:hi" or
        "lo:hi:log", or a list of values.
    render_mode : str, optional
        "rgb_array" or "human".

    Raises
    ------
    SceneError
        The scene is wrong, or has no reference, or its worm has not been identified, or a key cannot be varied.
    ValueError
        The control period is shorter than a time step, or `acts`, a channel or the render mode is unknown.
    ConnectionError
        The live page cannot be served.
    """

    metadata: ClassVar[Info] = {"render_modes": ["human", "rgb_array"], "render_fps": 5}

    def __init__(
        self,
        scene: str = "path_line",
        overrides: Sequence[str] = (),
        control_period: float = 0.2,
        acts: str = "course",
        channels: Sequence[str] = (),
        vary: Mapping[str, Any] | None = None,
        render_mode: str | None = None,
    ) -> None:
        self.render_mode = _known(render_mode, self.metadata)
        terms = Terms(control_period, acts, tuple(channels))
        self._worm = _Worm(scene, overrides, vary, terms, render_mode is not None)
        self._page = Page() if render_mode == "human" else None
        self.action_space, self.observation_space = self._worm.actions, self._worm.observations

    def reset(self, *, seed: int | None = None, options: Info | None = None) -> tuple[Seen, Info]:
        """Begin an episode. Without a seed, the random numbers continue the sequence of the previous episode."""
        super().reset(seed=seed)
        self._episode = self._worm.episode(self.np_random)
        if self._page:
            self._page.begin(self._episode.run)
        return self._episode.observed().astype(np.float32), {}

    def step(self, action: Seen) -> tuple[Seen, float, bool, bool, Info]:
        """Crawl for a control period with the given action."""
        watch = self._page.show if self._page else None
        reward, terminated, truncated, facts = self._episode.crawl(action, watch)
        return self._episode.observed().astype(np.float32), reward, terminated, truncated, facts

    def render(self) -> Picture | None:
        """Return a picture, shape (height, width, 3), with the render mode "rgb_array", and otherwise None."""
        return self._episode.picture() if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """End the live page."""
        if self._page:
            self._page.close()


class WormVectorEnv(VectorEnv[Seen, Seen, Any]):
    """Many worms at once, each in its own episode.

    Parameters
    ----------
    num_envs : int
        Number of worms.
    scene, overrides, control_period, acts, channels, vary
        As in `WormEnv`.
    threads : int
        Number of worms that are simulated at the same time. The compiled time steps release Python's global lock.
    render_mode : str, optional
        "rgb_array".

    Raises
    ------
    SceneError, ValueError
        As in `WormEnv`. ValueError is also raised if `num_envs` or `threads` is below 1.
    """

    metadata: ClassVar[Info] = {"render_modes": ["rgb_array"], "autoreset_mode": AutoresetMode.SAME_STEP}

    def __init__(
        self,
        num_envs: int,
        scene: str = "path_line",
        overrides: Sequence[str] = (),
        control_period: float = 0.2,
        acts: str = "course",
        channels: Sequence[str] = (),
        vary: Mapping[str, Any] | None = None,
        threads: int = 1,
        render_mode: str | None = None,
    ) -> None:
        arguments.whole("num_envs", num_envs, ge=1)
        arguments.whole("threads", threads, ge=1)
        self.render_mode = _known(render_mode, self.metadata)
        terms = Terms(control_period, acts, tuple(channels))
        self._worm, self.num_envs = _Worm(scene, overrides, vary, terms, render_mode is not None), num_envs
        self.single_action_space, self.single_observation_space = self._worm.actions, self._worm.observations
        self.action_space = batch_space(self._worm.actions, num_envs)
        self.observation_space = batch_space(self._worm.observations, num_envs)
        self._pool = ThreadPoolExecutor(threads)

    def reset(self, *, seed: int | list[int | None] | None = None, options: Info | None = None) -> tuple[Seen, Info]:
        """Begin an episode of each worm. Worm k uses the seed `seed + k`, or seed k of a list."""
        if isinstance(seed, int):
            seed = [seed + k for k in range(self.num_envs)]
        seeds = [None] * self.num_envs if seed is None else seed
        self._random = [np.random.default_rng(each) for each in seeds]
        self._episodes = [self._worm.episode(each) for each in self._random]  # CasADi, which worms need, has no threads
        return self._observed(), {}

    def step(self, actions: Seen) -> tuple[Seen, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], Info]:
        """Crawl for a control period. For worms whose episode ends, `info` has "final_obs" and "final_info"."""
        found = list(self._pool.map(Episode.crawl, self._episodes, actions))
        rewards, terminated, truncated, facts = zip(*found, strict=True)
        info: Info = {}
        for k, each in enumerate(facts):
            if terminated[k] or truncated[k]:
                each = {"final_obs": self._episodes[k].observed().astype(np.float32), "final_info": each}
                self._episodes[k] = self._worm.episode(self._random[k])
            info = self._add_info(info, each, k)
        return self._observed(), np.array(rewards), np.array(terminated), np.array(truncated), info

    def _observed(self) -> Seen:
        return np.array([episode.observed() for episode in self._episodes], dtype=np.float32)

    def render(self) -> tuple[Picture, ...] | None:
        """Return a picture of each worm with the render mode "rgb_array", and otherwise None."""
        return tuple(each.picture() for each in self._episodes) if self.render_mode == "rgb_array" else None

    def practice(self, count: int = 64) -> Practice:
        """Return `count` copies of the scene's worm in the reduced model, which takes little computing time.

        Raises
        ------
        ValueError
            `acts` is not "course".
        """
        return self._worm.practice(count)

    def close_extras(self, **_: Any) -> None:
        """End the threads."""
        self._pool.shutdown()


def _known(mode: str | None, metadata: Info) -> str | None:
    if mode is not None and mode not in metadata["render_modes"]:
        raise ValueError(f"render_mode: got {mode!r}, must be one of {', '.join(map(repr, metadata['render_modes']))}")
    return mode


for _name, _task in NAMED.items():
    _given = {"scene": _task.scene, "overrides": _task.overrides, "vary": _task.vary}
    gymnasium.register(
        f"{NAMESPACE}/{_name}",
        entry_point="scenes.gym_env:WormEnv",
        vector_entry_point="scenes.gym_env:WormVectorEnv",
        kwargs=_given,
    )
