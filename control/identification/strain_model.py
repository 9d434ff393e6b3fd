"""Model of the chamber strains of a healthy worm: linear filters of the commands to its chambers and hinges.

The strain s of a chamber c depends on eight inputs u_k: the commands of the chamber and of its twin (the chamber on the
other side of the segment), the commands of the four chambers in the neighbouring segments, and the hinges at both ends
of the segment. Each input passes first-order lags with M time constants T_m. Least squares fit the weights and a mean
to one run with changing amplitude, frequency and steering, and with different commands to different chambers:

    x_km' = (u_k - x_km)/T_m,    s_c = mean_c + sum_k sum_m w_ckm x_km                                        (SM1)

The left and right chambers of a segment have the same weights, but a hinge has opposite signs for them. On the default
worm (SM1) leaves 0.3 % of the variance of the strains unexplained in a second run. With only the chamber's own command
it leaves 0.5 %, and with a single time constant 1.6 %.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from control.gaits.steering import LEFT_RIGHT
from worm3d.values.arrays import FloatArray

TIME_CONSTANTS = (0.05, 0.1, 0.2)
"""Time constants T_m of a fitted model [s]. The chambers of the default worm have a lag of 0.1 s."""
INPUTS = 8
"""Number of inputs of a chamber, in the order of `inputs`. The first one is the chamber's own command."""


@dataclass(frozen=True, eq=False)
class StrainModel:
    """Strains of the chambers of a healthy worm of N segments, (SM1)."""

    time_constants: FloatArray
    """Time constants T_m, shape (M,) [s]."""
    weights: FloatArray
    """Weights w of the inputs for the chambers of each segment, shape (N, 8, M) [1, for hinges 1/rad]."""
    mean: FloatArray
    """Mean strain of the chambers of each segment, shape (N,)."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, StrainModel) and all(map(np.array_equal, vars(self).values(), vars(other).values()))

    __hash__ = None  # type: ignore[assignment]

    @property
    def segments(self) -> int:
        """Number of segments N."""
        return len(self.mean)

    def as_dict(self) -> dict[str, Any]:
        """Return the model as a JSON object, to six decimals."""
        return {name: np.round(value, 6).tolist() for name, value in vars(self).items()}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Self:
        """Return the model from the content of `as_dict`."""
        return cls(**{name: np.array(value, dtype=float) for name, value in content.items()})

    @classmethod
    def plain(cls, segments: int) -> Self:
        """Return the model of a worm that was not identified.

        It has one lag of the chamber's own command, as in the default worm.
        """
        weights = np.zeros((segments, INPUTS, 1))
        weights[:, 0] = -0.9
        return cls(np.array([0.1]), weights, np.zeros(segments))

    @classmethod
    def fit(
        cls, time: FloatArray, contraction: FloatArray, hinge: FloatArray, strain: FloatArray, skipped: float = 2.0
    ) -> Self:
        """Return the model fitted to a run.

        Parameters
        ----------
        time : ndarray of float, shape (K,)
            Instants of the rows [s].
        contraction, hinge : ndarray of float, shapes (K, N, 2) and (K, N - 1)
            Commands in force at these instants [1, rad].
        strain : ndarray of float, shape (K, N, 2)
            Strains at these instants. With fewer than two rows per weight, the result is `plain`.
        skipped : float
            Time at the start of the run that is excluded from the fit [s].
        """
        constants, segments, late = np.array(TIME_CONSTANTS), contraction.shape[1], time - time[0] >= skipped
        if late.sum() < 2 * INPUTS * len(constants):
            return cls.plain(segments)
        given = np.concatenate([contraction.reshape(len(time), -1), hinge], axis=1)[..., None]
        rows = [np.broadcast_to(given[0], (given.shape[1], len(constants)))]
        for k, dt in enumerate(np.diff(time).tolist()):
            rows.append(lagged(rows[-1], given[k], given[k + 1], constants, dt))
        x = np.array(rows)[late].transpose(0, 2, 1)
        known = inputs(x[..., : 2 * segments].reshape(*x.shape[:2], segments, 2), x[..., 2 * segments :])
        columns = known.transpose(2, 0, 3, 4, 1).reshape(segments, -1, INPUTS * len(constants))
        columns = np.concatenate([columns, np.ones((*columns.shape[:2], 1))], axis=-1)
        seen = strain[late].transpose(1, 0, 2).reshape(segments, -1)
        found = np.array([np.linalg.lstsq(*each, rcond=None)[0] for each in zip(columns, seen, strict=True)])
        return cls(constants, found[:, :-1].reshape(segments, INPUTS, -1), found[:, -1])


def inputs(contraction: FloatArray, hinge: FloatArray) -> FloatArray:
    """Return the inputs of each chamber, shape (..., N, 2, 8).

    `contraction` contains values of the chambers, shape (..., N, 2), and `hinge` values of the hinges, shape (..., N -
    1). The inputs are, in this order: the chamber and its twin, the same two of the segment behind, the same two of the
    segment ahead, the hinge behind, and the hinge ahead. Inputs beyond the ends of the worm are 0.
    """
    *more, segments, _ = contraction.shape
    values = np.zeros((*more, segments, 2, INPUTS))
    values[..., 0], values[..., 1] = contraction, contraction[..., ::-1]
    values[..., 1:, :, 2:4] = values[..., :-1, :, :2]
    values[..., :-1, :, 4:6] = values[..., 1:, :, :2]
    values[..., 1:, :, 6] = values[..., :-1, :, 7] = hinge[..., None] * LEFT_RIGHT
    return values


def lagged(before: FloatArray, begin: FloatArray, end: FloatArray, lag: FloatArray, dt: float) -> FloatArray:
    """Return the states of first-order lags [s] after `dt` > 0 [s].

    The input changes linearly from `begin` to `end`.
    """
    ramp = lag * (end - begin) / dt
    return np.asarray(end - ramp + (before - begin + ramp) * np.exp(-dt / lag))
