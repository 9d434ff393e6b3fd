"""Practice: many worms at once in a reduced model, some 400 times faster than the full simulation.

A policy whose actions are of the kind "course" is trained in this model first, and then in the full simulation. In the
model a worm follows a path with the arc length s and the curvature kappa(s). The worm has the offset e to the left of
the path, the heading theta relative to the path, the speed V and the turn rate w. The lags n_v (in waves) and T_w, the
frequency f and `blend` are those of (R1) in `control.estimation.reduced`. The gains g_v and g_w, the crab angle c
between heading and motion, and the yaw bias b describe deviations from the identified map:

    V' = (g_v V_cmd - V) f / n_v,   w' = (g_w w_s - w) / T_w,   w_s' = (w_cmd - w_s) f / blend,                (LM1)
    s' = V cos(theta + c) / (1 - kappa e),   e' = V sin(theta + c),   theta' = w + b - kappa s'.               (LM2)

Each episode has a random path (kappa = kappa_0 + kappa_1 sin(k s + phase), or a straight line) and random values of the
start, the required speed, the noise, the gains, the lags and the biases, within the ranges of `DRAWN`. The observation
has the layout of `control.learned.senses`. Positions are given by s and e, lengths are in body lengths, and the means
(LC1) and (LC2) of `control.learned.course` are means over samples.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from control.gaits.steering import BLEND
from control.identification.identified import Identified
from control.learned.acts import TRIM, TURN
from control.learned.senses import BASE_OBSERVATION_SIZE, CURVATURE_DISTANCES, FADING, OBSERVATION_LIMIT, assembled
from control.planning.feed_forward import FeedForward
from scenes.studies.learn.episode import reward_of
from worm3d.values.arrays import FloatArray

ACTIONS = 2
"""Number of values in an action: corrections of speed and turn rate."""
LOOKS = 4
"""Number of samples of the centre of mass in a control period."""
DRAWN: dict[str, tuple[float, float]] = {
    "speed": (0.04, 0.12),
    "bend": (-0.9, 0.9),
    "swing": (0.0, 1.0),
    "wavelength": (3.0, 7.0),
    "phase": (0.0, 6.3),
    "aside": (-0.2, 0.2),
    "heading": (-0.5, 0.5),
    "noise": (0.002, 0.01),
    "speed_gain": (0.8, 1.15),
    "turn_gain": (0.75, 1.3),
    "lag": (0.7, 1.4),
    "crab": (-0.1, 0.1),
    "yaw_bias": (-0.015, 0.015),
}
"""Smallest and largest random values of an episode, in body lengths, seconds and radians. Speeds and curvatures
(kappa_0 `bend`, kappa_1 `swing`) are within the range of the default worm. The gains cover other worms and slopes that
change the speed by up to a fifth. `aside` and `heading` are the offset and the heading at the start."""
STRAIGHT_SHARE = 0.3
"""Fraction of the paths that are straight lines."""
ON_PATH_SHARE = 0.4
"""Fraction of the episodes that begin on the path."""
DURATION = 30.0
"""Duration of an episode [s]."""


class Practice:
    """Worms in the reduced model, with those methods of `scenes.gym_env.WormVectorEnv` that the training calls.

    Parameters
    ----------
    count : int
        Number of worms.
    found : Identified
        Identified maps of the worm.
    length : float
        Body length [m].
    mechanism : str
        Steering mechanism.
    control_period : float
        Time between two actions [s].
    """

    def __init__(self, count: int, found: Identified, length: float, mechanism: Any, control_period: float) -> None:
        self.num_envs, self._period, self._dt = count, control_period, control_period / LOOKS
        ahead = FeedForward(found.maps[mechanism], length)
        self._frequency, lags = ahead.frequency, found.lags[mechanism]
        self._lags = np.array([lags.amplitude / self._frequency, lags.steering, BLEND / self._frequency])
        self._fastest, self._sharpest = ahead.fastest / length, ahead.sharpest(0.5 * ahead.fastest)
        self._wave = max(2, round(1.0 / (self._frequency * self._dt)))  # samples in a wave

    def reset(self, *, seed: int) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin the episodes of all worms, at different ages so that they do not end together."""
        self._random = np.random.default_rng(seed)
        n = self.num_envs
        self._drawn = {name: np.zeros(n) for name in DRAWN}
        self._state, self._steered = np.zeros((6, n)), np.zeros((n, round(1.0 / (self._frequency * self._period))))
        self._samples = np.zeros((2, 2, n, self._wave + self._wave // 2))  # true and measured, s and e
        self._age, self._means, self._action = np.zeros(n), np.zeros((n, 2)), np.zeros((n, ACTIONS))
        self._begin(np.ones(n, dtype=bool))
        self._age = self._random.uniform(0.0, 0.8 * DURATION, n).round(1)
        self._looks = np.full(n, 1)
        return self._observed(), {}

    def step(self, actions: NDArray[np.float32]) -> tuple[Any, FloatArray, NDArray[np.bool_], NDArray[np.bool_], Any]:
        """Crawl for a control period, as `scenes.gym_env.WormVectorEnv.step`."""
        self._action = np.clip(np.asarray(actions, dtype=float), -1.0, 1.0)
        self._steered = np.hstack([self._steered[:, 1:], self._action[:, 1:]])
        asked, now = self._drawn["speed"], self._curvature(self._state[0])
        speed = np.minimum(asked * (1.0 + TRIM * self._action[:, 0]), self._fastest)
        turn = np.clip((now + TURN * self._action[:, 1]) * asked, -self._sharpest, self._sharpest)
        for _ in range(LOOKS):
            self._move(speed, turn)
            self._look()
        self._age += self._period
        over = self._age >= DURATION - 1e-9
        self._fade()
        rewards, seen = reward_of(self._motion()[0][0, 1], self._miss(0)), self._observed()
        info = {"final_obs": seen.copy()}
        if over.any():
            self._begin(over)
            seen = self._observed()
        return seen, rewards, np.zeros_like(over), over, info

    def _begin(self, which: NDArray[np.bool_]) -> None:
        """Begin new episodes, with new random values, of the worms that `which` selects."""
        n = int(which.sum())
        for name, (low, high) in DRAWN.items():
            self._drawn[name][which] = self._random.uniform(low, high, n)
        drawn, straight, near = self._drawn, self._random.random(n), self._random.random(n)
        for name in ("bend", "swing"):
            drawn[name][which] *= straight >= STRAIGHT_SHARE
        for name in ("aside", "heading"):
            drawn[name][which] *= near >= ON_PATH_SHARE
        self._state[:, which] = 0.0
        self._state[1, which], self._state[2, which] = drawn["aside"][which], drawn["heading"][which]
        for part in (self._age, self._means, self._action, self._steered):
            part[which] = 0.0
        self._looks = np.where(which, 0, getattr(self, "_looks", np.zeros(self.num_envs, dtype=int)))
        self._look(which)

    def _curvature(self, s: FloatArray) -> FloatArray:
        """Return the curvatures of the paths of B worms at the arc lengths s, shape (B,) or (K, B)."""
        drawn = self._drawn
        swing: FloatArray = np.sin(2.0 * np.pi * s / drawn["wavelength"] + drawn["phase"])
        return drawn["bend"] + drawn["swing"] * swing

    def _move(self, speed: FloatArray, turn: FloatArray) -> None:
        """Take a step of (LM1) and (LM2) by the explicit Euler method. The step is much shorter than the lags."""
        drawn, (s, e, theta, v, w, steer) = self._drawn, self._state
        v_lag, w_lag, blend = self._lags[:, None] * drawn["lag"]
        kappa, way = self._curvature(s), theta + drawn["crab"]
        along = v * np.cos(way) / np.maximum(1.0 - kappa * e, 0.2)
        rates = (
            along,
            v * np.sin(way),
            w + drawn["yaw_bias"] - kappa * along,
            (drawn["speed_gain"] * speed - v) / v_lag,
            (drawn["turn_gain"] * steer - w) / w_lag,
            (turn - steer) / blend,
        )
        self._state = self._state + self._dt * np.array(rates)

    def _look(self, which: NDArray[np.bool_] | None = None) -> None:
        """Take a sample of the true and the measured positions.

        `which` selects worms that begin an episode. All samples of these worms are set to the new sample.
        """
        true = self._state[:2]
        measured = true + self._drawn["noise"] * self._random.standard_normal(true.shape)
        places = np.array([true, measured])
        if which is not None:
            self._samples[:, :, which] = places[:, :, which, None]
            return
        self._samples = np.concatenate([self._samples[..., 1:], places[..., None]], axis=-1)
        self._looks = self._looks + 1

    def _motion(self) -> tuple[FloatArray, FloatArray]:
        """Return the mean positions and velocities, (LC1) and (LC2), with a shape of (2, 2, B) each.

        The axes are: true or measured, s or e, and the worm.
        """
        half = self._wave // 2
        place = self._samples[..., half:].mean(axis=-1)
        before = self._samples[..., : self._wave].mean(axis=-1)
        return place, (place - before) / (half * self._dt)

    def _fade(self) -> None:
        """Update the exponentially weighted means of the offset and of the error of the speed."""
        left, (_, place) = np.exp(-self._period / FADING), self._motion()[0]
        errors = np.clip(np.array([10.0 * place[1], self._miss(1)]), -OBSERVATION_LIMIT, OBSERVATION_LIMIT).T
        self._means = left * self._means + (1.0 - left) * errors

    def _miss(self, measured: int) -> FloatArray:
        """Return the relative error of the speed, which is 0 in the first waves.

        `measured` is 0 for the error of the true speed and 1 for the error of the measured speed.
        """
        known = self._looks >= self._samples.shape[-1]
        return np.where(known, self._motion()[1][measured, 0] / self._drawn["speed"] - 1.0, 0.0)

    def _observed(self) -> NDArray[np.float32]:
        (_, place), (_, velocity) = self._motion()
        known, speed = self._looks >= self._samples.shape[-1], self._drawn["speed"]
        course = np.where(known, np.arctan2(velocity[1], velocity[0]), 0.0)
        ahead = place[0] + velocity[0] * known * 0.5 / self._frequency + CURVATURE_DISTANCES[:, None]
        seen = assembled(
            known,
            speed,
            self._miss(1),
            place[1],
            course,
            self._curvature(ahead),
            self._means.T,
            self._steered.mean(axis=1),
            self._action.T,
        )
        assert len(seen) == BASE_OBSERVATION_SIZE + ACTIONS
        return seen.T.astype(np.float32)
