"""Pictures from plain arrays: pages for a browser, figures, movies and meshes. The package does not need the simulator.

Import the modules `figure`, `movie`, `meshes` and `live` directly. They are not imported here because they load large
libraries.
"""

from worm3d.viewer.frames import Frames
from worm3d.viewer.html import write_html
from worm3d.viewer.world import WorldMesh, banded_pipe, chequered, heightfield, pipe, plane

__all__ = ["Frames", "WorldMesh", "banded_pipe", "chequered", "heightfield", "pipe", "plane", "write_html"]
