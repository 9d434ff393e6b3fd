"""The page of `html` inside a notebook cell."""

from __future__ import annotations

import webbrowser
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from tempfile import NamedTemporaryFile

from worm3d.viewer.frames import Frames
from worm3d.viewer.html import html


@dataclass(frozen=True)
class NotebookView:
    """Shows itself where it is the value of a notebook cell; the page lives in the notebook and needs no server.

    Attributes
    ----------
    page : str
        HTML of the page.
    height : int
        [pixels].
    """

    page: str = field(repr=False)
    height: int = 520

    def open(self) -> Path:
        """Open the page in a browser, and return the temporary file that holds it."""
        with NamedTemporaryFile("w", prefix="worm3d-", suffix=".html", encoding="utf-8", delete=False) as file:
            file.write(self.page)
        webbrowser.open(Path(file.name).as_uri(), new=2)
        return Path(file.name)

    def _repr_html_(self) -> str:
        return (
            f'<iframe srcdoc="{escape(self.page, quote=True)}" style="width: 100%; height: {self.height}px; border: 0" '
            'title="worm3d viewer"></iframe>'
        )


def show(
    frames: Frames, *, height: int = 520, fps: float | None = 25.0, skin: bool = True, play: bool = False
) -> NotebookView:
    """Return the run for the end of a notebook cell; `fps`, `skin` and `play` as in `write_html`.

    Parameters
    ----------
    height : int
        Of the cell [pixels].
    """
    return NotebookView(html(frames, fps=fps, skin=skin, play=play), height)
