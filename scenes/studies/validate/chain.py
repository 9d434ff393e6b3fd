"""Chains of rigid feet and muscles: the crawlers of the closed forms, as scenes of the 3D worm describe them.

A scene makes every segment either a *foot*, whose actuator may not change its length, or a *muscle*, which is lower
than the feet and touches nothing. The feet stand at one height for all lengths of the muscles, and joints that are
stiff in pitch make the chain a straight beam. The gait therefore prescribes the relative motion of the contacts, and
statics determine the loads. A slow gait makes inertia negligible. The closed forms make these assumptions.

*Equal loads.* A stiff beam presses N feet of equal stiffness with loads that are linear in their places. The sum of the
loads is m g, and they have no moment about the centre of mass. The feet's friction has no moment on the whole either,
since it acts at one height and its sum vanishes. The loads are therefore equal if the centre of mass lies at the mean
place of the feet. By symmetry, this holds if the muscles move in unison. In a wave, this holds except for the share of
the ends. `Crawl.unevenness` measures the deviation from equal loads.

*A payload* P at the head, the joint half a foot's length l0 ahead of the front foot, adds to the loads of two feet at
the distance D: P g (1 + l0/(2 D)) to the front foot's load and -P g l0/(2 D) to the rear foot's load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

import worm3d
from scenes.models.loading import load_scene
from scenes.models.worm.build import simulate
from scenes.studies.validate.measures import VALIDATION_FOLDER
from worm3d.values.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class Chain:
    """Feet and muscles of a scene.

    Parameters
    ----------
    settings
        Settings of a scene of the model `worm`.
    """

    settings: Any

    @classmethod
    def of(cls, scene: str, overrides: Sequence[str] = ()) -> Chain:
        """Return the chain of a scene in the folder of this module.

        Raises
        ------
        SceneError
            The overrides make an invalid scene.
        """
        return cls(load_scene(VALIDATION_FOLDER / f"{scene}.toml", overrides).settings)

    @cached_property
    def is_foot(self) -> BoolArray:
        """Whether each segment is a foot, shape (segments,)."""
        greatest = np.asarray(self.settings.actuator.greatest, dtype=float)
        return np.broadcast_to(greatest == 0.0, (self.settings.worm.segments,))

    @property
    def feet(self) -> int:
        """Number N of feet."""
        return int(self.is_foot.sum())

    @property
    def muscles(self) -> int:
        """Number of muscles."""
        return int(self.settings.worm.segments) - self.feet

    @property
    def l0(self) -> float:
        """Rest length of a segment [m]."""
        return float(self.settings.worm.length_m) / int(self.settings.worm.segments)

    @property
    def swing(self) -> float:
        """Amplitude a of the length of a muscle [m]."""
        return float(self.settings.gait.amplitude) * self.l0

    @property
    def level(self) -> float:
        """Level q = mu_forward/(mu_forward + mu_backward) of the quantile law."""
        forward, backward = float(self.settings.friction.forward), float(self.settings.friction.backward)
        return forward / (forward + backward)

    @property
    def slipping_back(self) -> int:
        """Number k = floor(N q) of equally loaded feet that slip back while the next foot holds."""
        return int(np.floor(self.feet * self.level))

    @property
    def steps(self) -> int:
        """Number of time steps in a period of the gait."""
        return round(float(self.settings.gait.period_s) / float(self.settings.run.dt_s))


@dataclass(frozen=True)
class Crawl:
    """Run of a chain."""

    chain: Chain
    result: worm3d.Result

    @classmethod
    def of(cls, chain: Chain) -> Crawl:
        """Simulate a chain.

        Raises
        ------
        ValueError
            The run does not reach its end, or a segment other than a foot touches the ground.
        """
        result = simulate(chain.settings, lambda _: True)
        if result.status is not worm3d.Status.DONE:
            raise ValueError(result.stop.sentence)
        if result.normal_load[:, ~chain.is_foot].any():
            raise ValueError("a muscle touches the ground, so that the loads are not those of the closed form")
        return cls(chain, result)

    @cached_property
    def places(self) -> FloatArray:
        """Place of each foot along the way at each instant, shape (T, N) [m]."""
        places: FloatArray = self.result.apexes[:, self.chain.is_foot, 0, 0]
        return places

    @cached_property
    def loads(self) -> FloatArray:
        """Load of each foot in each step, shape (T - 1, N) [N]."""
        loads: FloatArray = self.result.normal_load[1:, self.chain.is_foot].sum(axis=2)
        return loads

    @property
    def unevenness(self) -> float:
        """Largest deviation of a foot's load from the mean load, over the mean load."""
        return float(np.abs(self.loads / self.loads.mean() - 1.0).max())

    @property
    def travel(self) -> float:
        """Mean displacement of the feet in the last period [m]."""
        return float((self.places[-1] - self.places[-1 - self.chain.steps]).mean())
