"""A policy, which is a small network from an observation to an action. It is stored as a file of plain arrays.

z_0 = seen,    z_{k+1} = tanh(W_k z_k + b_k),    action = clip(W_n z_n + b_n, -1, 1)                      (LP1)
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from control.learned.acts import ACTS
from control.learned.senses import BASE_OBSERVATION_SIZE
from worm3d.values import regular_file
from worm3d.values.arrays import FloatArray
from worm3d.values.spelling import Spelled

SHIPPED_POLICY = Path(__file__).with_name("policy.npz")
"""File of the supplied policy."""
POLICY_OF: Mapping[str, Path] = {
    "worm3d/PathFollow-v0": SHIPPED_POLICY,
    **{
        f"worm3d/{name}-v0": SHIPPED_POLICY.with_name(f"{name.lower()}.npz")
        for name in ("Velocity", "Pipe", "Slope", "Terrain")
    },
}
"""Files of the policies that were trained for the named environments of Gymnasium."""
ABOUT = "about"
"""Name of the entry in a file that describes how the policy was trained."""


@dataclass(frozen=True, eq=False)
class Policy(Spelled):
    """A network (LP1), and a description of the training.

    Raises
    ------
    ValueError
        The sizes of the layers do not match, the last size is not the size of an action, or the values are not finite.
    """

    layers: tuple[tuple[FloatArray, FloatArray], ...]
    """Weights, shape (outputs, inputs), and offsets, shape (outputs,), of each layer."""
    about: Mapping[str, Any] = field(default_factory=dict)
    """Description of the training. "acts" is the kind of action, and "channels" are the sensor channels that the policy
    observes in addition to the `senses.BASE_OBSERVATION_SIZE` numbers."""

    def __post_init__(self) -> None:
        if not (isinstance(self.about, Mapping) and all(isinstance(name, str) for name in self.channels)):
            raise ValueError(f"about: got {type(self.about).__name__}, must be a mapping, with names as its channels")
        sizes = [weights.shape for weights, _ in self.layers]
        fits = all(len(size) == 2 for size in sizes) and all(b.shape == w.shape[:1] for w, b in self.layers)
        if not (sizes and fits and all(a[0] == b[1] for a, b in pairwise(sizes))):
            raise ValueError(f"layers: got {sizes}, must fit to one another, (outputs, inputs) of each")
        if self.acts not in ACTS:
            raise ValueError(f"acts: got {self.acts!r}, must be one of {', '.join(ACTS)}")
        outputs = ACTS[self.acts].size
        wanted = BASE_OBSERVATION_SIZE + outputs
        if sizes[-1][0] != outputs or self.inputs < wanted:
            got = f"{self.inputs} inputs and {sizes[-1][0]} outputs"
            raise ValueError(f"layers: got {got}, must be {wanted} inputs or more, and {outputs} outputs")
        if not all(np.isfinite(part).all() for layer in self.layers for part in layer):
            raise ValueError("layers: got values that are not finite; the training has failed")

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return int(self.layers[0][0].shape[1])

    @property
    def acts(self) -> str:
        """Kind of the policy's actions, a key of `control.learned.acts.ACTS`."""
        return str(self.about.get("acts", "course"))

    @property
    def channels(self) -> Sequence[str]:
        """Observed sensor channels in addition to the `senses.BASE_OBSERVATION_SIZE` numbers."""
        return tuple(self.about.get("channels", ()))

    def __call__(self, seen: FloatArray) -> FloatArray:
        """Return the action, (LP1), shape (A,)."""
        (*hidden, (weights, offsets)) = self.layers
        for inner, aside in hidden:
            seen = np.tanh(inner @ seen + aside)
        return np.clip(weights @ seen + offsets, -1.0, 1.0)

    def save(self, path: Path) -> None:
        """Write the policy to a file in numpy's .npz format."""
        arrays = {
            f"{name}{k}": part for k, layer in enumerate(self.layers) for name, part in zip("Wb", layer, strict=True)
        }
        with path.open("wb") as file:
            np.savez_compressed(file, **arrays, **{ABOUT: np.array(json.dumps(dict(self.about)))})  # type: ignore[arg-type]

    @classmethod
    def load(cls, path: Path = SHIPPED_POLICY) -> Policy:
        """Return the policy that is stored in a file.

        Raises
        ------
        ValueError
            The file cannot be read, does not contain a policy, or is damaged.
        """
        try:
            data = regular_file.read(path, 100_000_000)  # a policy with two layers of 1000 has 8 MB
        except OSError as error:
            raise ValueError(f"{path}: cannot be read: {error.strerror or error}") from error
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # numpy only warns of foreign arrays, and accepts them
                return cls(*_unpacked(data))
        except Exception as error:  # damaged zip files and arrays raise various errors
            why = (str(error).splitlines() or [""])[0][:120]
            raise ValueError(
                f"{path}: is no policy of 'worm3d learn', or a damaged one ({type(error).__name__}: {why}); "
                "take a copy of it, or train it again"
            ) from error


def _unpacked(data: bytes) -> tuple[tuple[tuple[FloatArray, FloatArray], ...], Any]:
    """Return the layers and the description from the bytes of a file. Other files raise various exceptions."""
    with np.load(BytesIO(data), allow_pickle=False) as found:
        about = json.loads(str(found[ABOUT]))
        count = sum(name.startswith("W") for name in found.files)
        layers = tuple((found[f"W{k}"].astype(float), found[f"b{k}"].astype(float)) for k in range(count))
    return layers, about
