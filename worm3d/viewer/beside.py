"""Several pages of runs side by side, played by one set of controls; one file, without a network."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from worm3d.viewer.html import filled, resource

MAX_PAGES = 6
"""Largest number of pages: browsers draw only about ten scenes at a time."""


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
    """Return a page that shows other pages side by side, all at the same time of the runs and from the same side.

    A run that begins later or ends earlier stands still before and after. The page's address may select the first view:
    `compare.html#t=2.5&camera=top&play=1`, with the time of the runs [s] and the cameras of the pages.

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
