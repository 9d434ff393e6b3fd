"""The worm in the browser while it is simulated, through meshcat's server."""

from __future__ import annotations

import webbrowser
from collections.abc import Sequence
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from worm3d.values.arrays import FloatArray
from worm3d.viewer import pieces, recorder
from worm3d.viewer.connection import Connection, Server
from worm3d.viewer.frames import Frames
from worm3d.viewer.piece import Piece
from worm3d.viewer.pieces import Scales
from worm3d.viewer.world import WorldMesh

_REFRESH = 500
"""Frames."""


class LiveView:
    """A window in the browser that shows the worm as it is now; use it in a `with` statement.

    It shows chambers, links and end faces, which only have to be moved; a skin, as on the page of a result, would have
    to be sent anew for each picture.

    Parameters
    ----------
    world : sequence of WorldMesh
        Sent once.
    address : str, optional
        Of the command socket of a meshcat server that runs already, e.g. "tcp://127.0.0.1:6000"; one is started, and
        stopped by `close`, if left out.
    strain_limit : float
        Strain at full colour.
    force_scale : float
        Force drawn as an arrow of a fifth of the body [N].
    open_browser : bool
        Whether a browser is opened; the address to visit is `url` in any case.
    timeout : float
        How long to wait for the server [s].

    Raises
    ------
    ConnectionError
        The server does not start, or does not answer, in time.
    """

    def __init__(
        self,
        world: Sequence[WorldMesh] = (),
        *,
        address: str | None = None,
        strain_limit: float = 0.45,
        force_scale: float = 0.2,
        open_browser: bool = False,
        timeout: float = 10.0,
    ) -> None:
        self._scales = Scales(strain_limit, force_scale)
        self._placed: set[str] = set()
        self._shown = 0
        self._server: Server | None = None
        self._window: Connection | None = None
        try:
            if address is None:
                self._server = Server(timeout)
                address = self._server.address
            self._window = Connection(address, timeout)
            self.url = self._window.ask("url")
            recorder.stage(self._window)
            for piece in pieces.world(tuple(world)):
                recorder.place(self._window, piece)
            self._window.settle()
        except BaseException:
            self.close()
            raise
        if open_browser:
            webbrowser.open(self.url, new=2)

    def show(
        self,
        joints: FloatArray,
        apexes: FloatArray,
        directors: FloatArray,
        chamber_strain: FloatArray,
        *,
        faces: FloatArray | None = None,
        face_radius: FloatArray | None = None,
        contact_force: FloatArray | None = None,
        anchored: NDArray[np.bool_] | None = None,
        horizon: FloatArray | None = None,
        caption: str = "",
    ) -> None:
        """Show the worm at one instant; arrays as in `Frames`, without the first axis.

        Parameters
        ----------
        joints : ndarray, shape (N+1, 3)
            [m].
        apexes : ndarray, shape (N, 6, 3)
            [m].
        directors : ndarray, shape (N, 3)
        chamber_strain : ndarray, shape (N, 2)
        faces : ndarray, shape (N, 2, 3), optional
            [m].
        face_radius : ndarray, shape (2,), optional
            [m].
        contact_force : ndarray, shape (N, K, 3), optional
            [N].
        anchored : ndarray of bool, shape (N, K), optional
        horizon : ndarray, shape (H, 3), optional
            [m].
        caption : str
            At the top of the picture.
        """
        if self._window is None:
            raise ConnectionError("the live view is closed: open a new one")
        if self._server is not None and not self._server.running:
            raise ConnectionError("live view: meshcat's server has stopped: open a new view")
        frames = Frames(
            time=np.zeros(1),
            joints=joints[None],
            apexes=apexes[None],
            directors=directors[None],
            chamber_strain=chamber_strain[None],
            faces=None if faces is None else faces[None],
            face_radius=face_radius,
            contact_force=None if contact_force is None else contact_force[None],
            anchored=None if anchored is None else anchored[None],
            horizon=None if horizon is None else horizon[None],
        )
        parts = [*pieces.worm(frames, self._scales), *pieces.contact(frames, self._scales), *pieces.way(frames)]
        if not self._placed:
            recorder.stand(self._window, frames.axes, frames.body_length)
        self._send(self._window, {part.path: part for part in parts})
        recorder.look_at(self._window, frames.centre[0])
        if caption:
            recorder.caption(self._window, caption)
        self._window.settle()

    def _send(self, window: Connection, parts: dict[str, Piece]) -> None:
        for path, part in parts.items():
            # The server keeps every colour it is told, until the piece is placed again.
            stale = part.tint is not None and self._shown % _REFRESH == 0
            if stale or path not in self._placed:
                recorder.place(window, part)
            recorder.move(window, part)
        for path in sorted(self._placed - parts.keys()):
            recorder.remove(window, path)
        self._placed = set(parts)
        self._shown += 1

    def close(self) -> None:
        """Close the connection, and stop the server if it was started here; may be called twice."""
        if self._window is not None:
            self._window.close()
            self._window = None
        if self._server is not None:
            self._server.stop()
            self._server = None

    def __enter__(self) -> LiveView:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
