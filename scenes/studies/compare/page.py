"""The HTML page that shows several runs side by side and plays them together."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from scenes.records.folder import VIEWER
from scenes.records.record import Record
from scenes.running.drawing import is_drawable, pictures_of
from worm3d.viewer.beside import MAX_PAGES, Page, side_by_side

COMPARISON_PAGE_FILE = "compare.html"


def pages(records: Mapping[str, Record], title: str) -> tuple[dict[str, bytes], str]:
    """Return the HTML page of all records that can be shown in 3D, and an empty string.

    The page is returned as a dictionary from file name to content. If fewer than two or too many records can be shown,
    the dictionary is empty and the string gives the reason.
    """
    shown = {label: record for label, record in records.items() if _has_page(record)}
    if 2 <= len(shown) <= MAX_PAGES:
        return {COMPARISON_PAGE_FILE: side_by_side([_page(*each) for each in shown.items()], title).encode()}, ""
    allowed = "two or more" if len(shown) < 2 else f"{MAX_PAGES} at most"
    return {}, f"no page side by side: {len(shown)} of the results can be seen in 3D, must be {allowed}"


def _has_page(record: Record) -> bool:
    return bool(record.scene) and is_drawable(record) and pictures_of(record).view is not None


def _page(label: str, record: Record) -> Page:
    view = pictures_of(record).view
    assert view is not None
    with TemporaryDirectory(prefix="worm3d-") as folder:
        file = Path(folder) / VIEWER
        view(record, file)
        return Page(label, file.read_text("utf-8"), float(record["time"][0]), float(record["time"][-1]))
