"""Results whose bits flip: each is refused in a sentence, or says what it said before."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fuzzing import TIMES, no_hang

from scenes.language.errors import SceneError
from scenes.models.loading import load_scene
from scenes.records import store
from scenes.running.runner import simulate
from worm3d.values import netcdf

SEED = 5 if TIMES == 1 else None


@pytest.fixture(scope="module")
def whole() -> bytes:
    """A result of the 3D worm as it stands on disc, with what a run goes on from."""
    record = simulate(load_scene("flat", ["run.duration_s=0.2"]))
    return netcdf.packed(netcdf.signed(store.content_of(record)))


@pytest.mark.parametrize(
    ("cut", "flips"), [(0, 500), (netcdf.SEAL_LENGTH, 6)], ids=["as written", "without the digest of the bytes"]
)
def test_flipped_bits(cut: int, flips: int, whole: bytes, tmp_path: Path) -> None:
    """Without that digest each file is read by a process of its own."""
    path, random = tmp_path / "result.nc", np.random.default_rng(SEED)
    kept, mark = whole[: len(whole) - cut], range(len(whole) - netcdf.SEAL_LENGTH, len(whole) - 65)
    path.write_bytes(whole)
    expected = store.content_of(store.load(path)).digest
    for place in random.integers(8 * len(kept), size=flips * TIMES):
        damaged = bytearray(kept)
        damaged[place // 8] ^= 1 << (place % 8)
        path.write_bytes(damaged)
        try:
            with no_hang():
                found = store.load(path)
        except SceneError as error:
            (line,) = error.lines
            assert line.startswith(str(path))
        else:
            assert store.content_of(found).digest == expected
            assert cut or place // 8 in mark, "the digest is not taken for one if the mark before it is damaged"
