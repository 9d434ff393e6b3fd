"""Files that are kept on disk for the next process: compiled code, distance grids, identified worms.

`files` keeps bytes under a key and verifies them before anyone sees them, `locks` lets one process at a time make what
is missing, and `trust` says whose files are believed. Nothing here needs a compiler, or knows a worm.
"""

from worm3d.machine.cache.files import folder, load, obstacle, store
from worm3d.machine.cache.locks import alone

__all__ = ["alone", "folder", "load", "obstacle", "store"]
