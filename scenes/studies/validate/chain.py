"""Chains of rigid feet and muscles with solutions in closed form, and their runs as scenes of the 3D worm.

In such a scene every segment of the worm is either a *foot* or a *muscle*. A foot has a constant length. A muscle
changes its length; it is lower than the feet and does not touch the ground. All feet have the same height, which does
not depend on the lengths of the muscles, and the joints are stiff in pitch, so that the chain is a straight beam. The
closed forms assume that the gait prescribes the relative motion of the feet, that the loads follow from statics, and
that inertia is negligible. The scenes satisfy these assumptions; the gait is slow.

*Equal loads.* The loads of N feet of equal stiffness under a stiff beam are a linear function of the positions of the
feet. The sum of the loads is m g, and their moment about the centre of mass is zero. The friction forces have no
moment, since all act at the same height and their sum is zero. The loads are therefore equal if the position of the
centre of mass is the mean position of the feet. By symmetry, this is true if the muscles move in unison. In a wave it
is only approximately true, because of the ends of the chain. `Crawl.unevenness` measures the deviation.

*Payload.* A payload of mass P hangs on the joint at the head. This joint is ahead of the centre of the front foot by
half the foot's length l0. With two feet at the distance D, the payload adds P g (1 + l0/(2 D)) to the load of the front
foot and -P g l0/(2 D) to the load of the rear foot.
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
    """Chain of feet and muscles, as described by a scene.

    Parameters
    ----------
    settings
        Settings of the scene, whose model is `worm`.
    """

    settings: Any

    @classmethod
    def of(cls, scene: str, overrides: Sequence[str] = ()) -> Chain:
        """Return the chain of a scene in the folder of this module, with overrides `section.key=value`.

        Raises
        ------
        SceneError
            The scene is not valid with these overrides.
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
        """Amplitude a of the length changes of a muscle [m]."""
        return float(self.settings.gait.amplitude) * self.l0

    @property
    def level(self) -> float:
        """Level q = mu_forward/(mu_forward + mu_backward) of the quantile law (`scenes.studies.validate.formulas`)."""
        forward, backward = float(self.settings.friction.forward), float(self.settings.friction.backward)
        return forward / (forward + backward)

    @property
    def slipping_back(self) -> int:
        """Number k = floor(N q) of feet that slip back at a time, if the loads of the feet are equal."""
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
        """Return the run of a chain.

        Raises
        ------
        ValueError
            The run stops early, or a muscle touches the ground.
        """
        result = simulate(chain.settings, lambda _: True)
        if result.status is not worm3d.Status.DONE:
            raise ValueError(result.stop.sentence)
        if result.normal_load[:, ~chain.is_foot].any():
            raise ValueError("a muscle touches the ground, so the closed form does not apply: make the muscles lower")
        return cls(chain, result)

    @cached_property
    def places(self) -> FloatArray:
        """Position x of each foot at each of T instants, shape (T, N) [m]."""
        places: FloatArray = self.result.apexes[:, self.chain.is_foot, 0, 0]
        return places

    @cached_property
    def loads(self) -> FloatArray:
        """Load of each foot in each step, shape (T - 1, N) [N]."""
        loads: FloatArray = self.result.normal_load[1:, self.chain.is_foot].sum(axis=2)
        return loads

    @property
    def unevenness(self) -> float:
        """Largest deviation of a foot's load from the mean load, divided by the mean load."""
        return float(np.abs(self.loads / self.loads.mean() - 1.0).max())

    @property
    def travel(self) -> float:
        """Mean displacement of the feet in the last period [m]."""
        return float((self.places[-1] - self.places[-1 - self.chain.steps]).mean())
