"""Files that are kept on disk for the next process: compiled code, distance grids, identified worms.

`files` keeps bytes under a key and verifies the bytes before use, `locks` lets one process at a time make a missing
file, and `trust` decides which files are trusted. This package needs no compiler and is independent of worms.
"""

from worm3d.machine.cache.files import folder, load, obstacle, store
from worm3d.machine.cache.locks import alone, load_or_make

__all__ = ["alone", "folder", "load", "load_or_make", "obstacle", "store"]
