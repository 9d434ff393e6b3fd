"""The pages of several runs side by side, played together."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from scenes.records.folder import VIEWER, write_bytes
from scenes.records.record import Record
from scenes.running.drawing import is_drawable, pictures_of
from worm3d.viewer.beside import MAX_PAGES, Page, side_by_side


def write(records: Mapping[str, Record], path: Path, title: str) -> str:
    """Write the common page of the records with a 3D page, by label; return the reason if there is none, or "".

    Raises
    ------
    DiscError
        The file cannot be written.
    """
    shown = {label: record for label, record in records.items() if _has_page(record)}
    if len(shown) < 2:
        return f"no page side by side: {len(shown)} of the results can be seen in 3D, must be two or more"
    if len(shown) > MAX_PAGES:
        return f"no page side by side: {len(shown)} of the results can be seen in 3D, must be {MAX_PAGES} at most"
    write_bytes(path, side_by_side([_page(*each) for each in shown.items()], title).encode())
    return ""


def _has_page(record: Record) -> bool:
    return bool(record.scene) and is_drawable(record) and pictures_of(record).view is not None


def _page(label: str, record: Record) -> Page:
    view = pictures_of(record).view
    assert view is not None
    with TemporaryDirectory(prefix="worm3d-") as folder:
        file = Path(folder) / VIEWER
        view(record, file)
        return Page(label, file.read_text("utf-8"), float(record["time"][0]), float(record["time"][-1]))
