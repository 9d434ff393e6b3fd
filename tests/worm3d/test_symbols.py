"""Object code that needs names of Numba's own is not kept, and never called where the names are missing."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from kept_files import double, total

from worm3d.machine.codegen import native
from worm3d.machine.functions import Function

SCRIPT = """
import sys
import numpy as np
from worm3d.machine.compiled import njit

@njit
def flattened(square: np.ndarray) -> float:
    return float(square.ravel()[3] + np.dot(square, square)[1, 1])

@njit
def plain(square: np.ndarray) -> float:
    return float(square[1, 1])

square = np.arange(4.0).reshape(2, 2)
print(flattened(square), plain(square), "numba" in sys.modules)
"""


def called(folder: Path) -> tuple[list[str], str]:
    """Return what the script prints, and what it says on stderr."""
    script = folder / "flat.py"
    script.write_text(SCRIPT)
    places = os.environ | {"XDG_CACHE_HOME": str(folder / "cache")}
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, env=places, check=False)
    assert done.returncode == 0, (done.returncode, done.stderr)
    return done.stdout.split(), done.stderr


def test_code_that_calls_numba_itself_is_not_kept_and_says_so(tmp_path: Path) -> None:
    for _ in range(2):
        values, said = called(tmp_path)
        assert values == ["14.0", "3.0", "True"]
        assert "__main__.flattened is compiled in every process" in said
        assert "numba_attempt_nocopy_reshape" in said
        assert "numba_xxgemm" in said
        assert len(list((tmp_path / "cache").rglob("*.kernel"))) == 1, "the other one is kept"


def test_names_of_the_c_library_and_of_each_other_are_there() -> None:
    host = native.this_host()
    for function, args in ((total, (np.zeros(3),)), (double, (1.0,))):
        _, lacking = Function(function, lambda: "1", 1, lambda: None).compiled(args, None, host)
        assert lacking == ()
