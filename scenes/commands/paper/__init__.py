"""`worm3d paper`: the paper's tables, figures and claims from our own runs."""

from scenes.commands.paper.report import run

__all__ = ["run"]
