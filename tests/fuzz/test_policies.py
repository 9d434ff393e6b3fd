"""Files of policies damaged at random: each is refused with one sentence, or is the policy that it was."""

from __future__ import annotations

import io
import json
import random
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fuzzing import TIMES

from control.learned.policy import SHIPPED_POLICY, Policy

WHOLE = SHIPPED_POLICY.read_bytes()
COUNT = 400


def damaged(draw: random.Random) -> bytes:
    """Return the shipped file with bytes changed, a part lost or doubled, or its end cut off, or other bytes."""
    data, at = bytearray(WHOLE), draw.randrange(len(WHOLE))
    match draw.choice(("flip", "flips", "cut", "lose", "double", "zeros", "other")):
        case "flip":
            data[at] ^= 1 << draw.randrange(8)
        case "flips":
            for _ in range(draw.randint(2, 40)):
                data[draw.randrange(len(data))] = draw.randrange(256)
        case "cut":
            del data[at:]
        case "lose":
            del data[at : at + draw.randint(1, 200)]
        case "double":
            data[at:at] = data[at : at + draw.randint(1, 200)]
        case "zeros":
            data[at : at + 64] = bytes(len(data[at : at + 64]))
        case "other":
            data = bytearray(draw.randbytes(draw.randint(0, 4000)))
    return bytes(data)


def test_damaged_policies_are_refused_in_one_sentence(tmp_path: Path) -> None:
    path, draw, seen, refused = tmp_path / "policy.npz", random.Random(31), np.linspace(-1.0, 1.0, 99), 0
    whole = Policy.load()
    for _ in range(COUNT * TIMES):
        path.write_bytes(damaged(draw))
        try:
            found = Policy.load(path)
        except ValueError as error:
            refused += 1
            _require_sentence(str(error), path)
        else:  # what was changed was not the policy
            np.testing.assert_array_equal(found(seen[: found.inputs]), whole(seen[: whole.inputs]))
    assert refused > 0.8 * COUNT


def rewritten(**changes: Any) -> bytes:
    """Return the shipped file, as numpy writes it, with some arrays changed; None leaves one out."""
    with np.load(SHIPPED_POLICY) as kept:
        arrays = {name: kept[name] for name in kept.files} | changes
    file = io.BytesIO()
    np.savez(file, **{name: array for name, array in arrays.items() if array is not None})
    return file.getvalue()


def with_member(content: bytes) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as made:
        made.writestr("about.npy", content)
    return file.getvalue()


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x00",
        b"PK\x05\x06" + bytes(18),
        b"\x93NUMPY\x01\x00",
        with_member(b""),
        with_member(b"\x93NUMPY\x01\x00\x76\x00{'descr': '<f8', 'fortran_order': False, 'shape': (1" + b"0" * 40),
        rewritten(about=np.array("3")),
        rewritten(about=np.array("[]")),
        rewritten(about=np.array("{")),
        rewritten(about=np.array("[" * 100_000)),
        rewritten(about=np.array('{"acts": "nothing"}')),
        rewritten(about=np.array('{"channels": 3}')),
        rewritten(about=np.array('{"channels": [3]}')),
        rewritten(about=None),
        rewritten(W0=None),
        rewritten(W0=np.array("x")),
        rewritten(W0=np.zeros((2, 2), dtype=complex)),
        rewritten(W0=np.zeros((0, 0))),
        rewritten(b0=np.zeros(3)),
        json.dumps({"W0": [1]}).encode(),
    ],
)
def test_files_of_other_kinds_are_refused_in_one_sentence(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "policy.npz"
    path.write_bytes(data)
    with pytest.raises(ValueError, match="is no policy") as refused:
        Policy.load(path)
    _require_sentence(str(refused.value), path)


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "gone.npz"):
        with pytest.raises(ValueError, match="cannot be read"):
            Policy.load(path)


def _require_sentence(text: str, path: Path) -> None:
    assert text.startswith(f"{path}: ")
    assert "\n" not in text
    assert len(text) < len(str(path)) + 300
