"""The commands of `worm3d` that run a scene many times, or compare runs; all heavy imports are inside of them."""

from __future__ import annotations

import typer

studies = typer.Typer(rich_markup_mode=None)
"""Commands that stand beside `run` and the others."""
