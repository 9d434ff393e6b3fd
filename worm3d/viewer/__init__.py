"""Pictures from plain arrays: a page for the browser, figures, movies, meshes. Independent of the simulator.

Heavy libraries are imported only where used: import `figure`, `movie`, `meshes` and `live` as modules.
"""

from worm3d.viewer.frames import Frames
from worm3d.viewer.html import write_html
from worm3d.viewer.world import WorldMesh, banded_pipe, chequered, heightfield, pipe, plane

__all__ = ["Frames", "WorldMesh", "banded_pipe", "chequered", "heightfield", "pipe", "plane", "write_html"]
