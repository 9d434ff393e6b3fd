"""Files that are stored on disk for later processes: compiled code, distance grids, identified worms.

`files` stores bytes under a key and verifies them before use. With `locks`, only one process at a time makes a missing
file. `trust` decides which files are trusted. This package needs no compiler and is independent of worms.
"""

from worm3d.machine.cache.files import folder, load, obstacle, store
from worm3d.machine.cache.locks import alone, load_or_make

__all__ = ["alone", "folder", "load", "load_or_make", "obstacle", "store"]
