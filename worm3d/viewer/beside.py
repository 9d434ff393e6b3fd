"""A page with several pages of runs side by side, which are played together. It is a single file without a network."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from worm3d.viewer.html import filled, resource

MAX_PAGES = 6
"""Largest number of pages. The number is limited because browsers draw only about ten scenes at a time."""


@dataclass(frozen=True)
class Page:
    """The page of a run, shown beside other pages."""

    label: str
    """Caption above the page."""
    html: str
    """Page from `worm3d.viewer.html.html`."""
    begin: float
    """First instant of the run [s]."""
    end: float
    """Last instant of the run [s]."""


def side_by_side(pages: Sequence[Page], title: str = "worm3d") -> str:
    """Return a page that shows other pages side by side, all at the same time and with the same camera.

    Before its begin and after its end, a run is shown with its first and last frame. The address of the page may set
    the first view, for example `compare.html#t=2.5&camera=top&play=1`, with the time [s] and the name of the camera.

    Raises
    ------
    ValueError
        Fewer than 2 pages, or more than `MAX_PAGES`.
    """
    if not 2 <= len(pages) <= MAX_PAGES:
        raise ValueError(f"pages: got {len(pages)}, must be 2 to {MAX_PAGES}")
    columns = len(pages) if len(pages) <= 3 else (len(pages) + 1) // 2
    runs = [{"begin": page.begin, "end": page.end} for page in pages]
    return filled(
        "beside.html",
        *(page.html for page in pages),
        title=escape(title),
        style=resource("beside.css"),
        columns=str(columns),
        frames="\n".join(_frame(page) for page in pages),
        runs=json.dumps(runs).replace("<", "\\u003c"),
        script=resource("beside.js"),
    )


def _frame(page: Page) -> str:
    label, inner = escape(page.label, quote=True), escape(page.html, quote=True)
    frame = f'<iframe name="worm3d-guest" title="{label}" srcdoc="{inner}"></iframe>'
    return f"<figure><figcaption>{label}</figcaption>{frame}</figure>"
