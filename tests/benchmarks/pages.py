"""What measurements of the program share: their options, and the page that is printed and written."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from matplotlib.figure import Figure

from scenes.records.folder import made, write_bytes
from scenes.running.drawing import save_figure


def options(description: str, page: str) -> argparse.Namespace:
    """Return the options of the command line, `quick` and `out`, and make the folder of `out`.

    Parameters
    ----------
    description : str
    page : str
        Name of the page, which is written to `runs` without `--out`.
    """
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="measure little, in seconds")
    parser.add_argument("--out", type=Path, default=Path("runs", page), metavar="PAGE.md", help="page to write")
    given = parser.parse_args()
    made(given.out.parent)
    return given


def publish(text: str, page: Path, figure: Figure | None = None) -> None:
    """Print a page in Markdown and write it, with a figure of the same name beside it."""
    sys.stdout.write(text)
    write_bytes(page, text.encode())
    if figure is not None:
        save_figure(figure, page.with_suffix(".png"))
