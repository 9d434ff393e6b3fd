"""Chains of rigid feet and muscles: scenes of the 3D worm that meet the assumptions of the closed forms.

In these scenes, every segment is either a *foot* or a *muscle*. The actuator of a foot does not change its length. A
muscle is lower than the feet and does not touch the ground. The feet stand at the same height for all lengths of the
muscles, and joints that are stiff in pitch make the chain a straight beam. The gait therefore prescribes the relative
motion of the contacts, and statics determine the loads. The gait is so slow that inertia is negligible.

*Equal loads.* If a stiff beam stands on N feet of equal stiffness, the load of a foot is a linear function of its
position. The sum of the loads is m g, and the sum of their moments about the centre of mass is zero. The friction
forces act at one height and their sum is zero, so that they have no moment. The loads are therefore equal if the centre
of mass lies at the mean position of the feet. By symmetry, this is true if the muscles move in unison. In a wave it is
true except for an effect of the ends of the body. `Crawl.unevenness` measures the deviation from equal loads.

*Payload.* A payload of mass P is at the head, which is half a segment length, l0/2, ahead of the front foot. If the
chain has two feet at the distance D, the payload adds P g (1 + l0/(2 D)) to the load of the front foot and
-P g l0/(2 D) to the load of the rear foot.
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
    """The chain of feet and muscles of a scene.

    Parameters
    ----------
    settings
        Settings of the scene, which has the model `worm`.
    """

    settings: Any

    @classmethod
    def of(cls, scene: str, overrides: Sequence[str] = ()) -> Chain:
        """Return the chain of a scene in the folder of this module.

        Raises
        ------
        SceneError
            The scene is invalid with the overrides.
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
        """Level q = mu_forward/(mu_forward + mu_backward) of the quantile law in `scenes.studies.validate.formulas`."""
        forward, backward = float(self.settings.friction.forward), float(self.settings.friction.backward)
        return forward / (forward + backward)

    @property
    def slipping_back(self) -> int:
        """Number k = floor(N q) of feet that slip back at a time, if all feet have equal loads."""
        return int(np.floor(self.feet * self.level))

    @property
    def steps(self) -> int:
        """Number of time steps in a period of the gait."""
        return round(float(self.settings.gait.period_s) / float(self.settings.run.dt_s))


@dataclass(frozen=True)
class Crawl:
    """A run of a chain with T stored instants and N feet."""

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
        """Position of each foot along the direction of crawling at each instant, shape (T, N) [m]."""
        places: FloatArray = self.result.apexes[:, self.chain.is_foot, 0, 0]
        return places

    @cached_property
    def loads(self) -> FloatArray:
        """Load of each foot in each step, shape (T - 1, N) [N]."""
        loads: FloatArray = self.result.normal_load[1:, self.chain.is_foot].sum(axis=2)
        return loads

    @property
    def unevenness(self) -> float:
        """Largest deviation of a foot's load from the mean load, relative to the mean load."""
        return float(np.abs(self.loads / self.loads.mean() - 1.0).max())

    @property
    def travel(self) -> float:
        """Mean displacement of the feet in the last period [m]."""
        return float((self.places[-1] - self.places[-1 - self.chain.steps]).mean())
