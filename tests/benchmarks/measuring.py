"""What measurements of the program share: options, processes, and the page that is printed and written."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Collection, Iterable, Iterator
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")
R = TypeVar("R")


def options(description: str, names: Collection[str] = (), **defaults: Any) -> argparse.Namespace:
    """Return the options of the command line.

    Parameters
    ----------
    description : str
    names : collection of str
        Allowed positional arguments. `names` of the result are those that are given, or all.
    **defaults
        Options with their default values, which give the types; a default of False makes a switch.
    """
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    if names:
        parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(names)}; all if left out")
    for name, value in defaults.items():
        if value is False:
            parser.add_argument(f"--{name}", action="store_true")
        else:
            parser.add_argument(f"--{name}", type=type(value), default=value, help=f"default {value}")
    given = parser.parse_args()
    if names:
        for name in given.names:
            if name not in names:
                parser.error(f"NAME: got {name!r}, must be one of {', '.join(names)}")
        given.names = given.names or list(names)
    return given


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def publish(text: str, page: Path) -> None:
    """Print a page in Markdown and write it."""
    say(text.rstrip("\n"))
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text(text, encoding="utf-8")


def mapped(go: Callable[[T], R], tasks: Iterable[T], workers: int, *, fresh: bool = False) -> Iterator[R]:
    """Yield the results of tasks from so many processes; with `fresh`, each task has a process of its own."""
    with get_context("spawn").Pool(workers, maxtasksperchild=1 if fresh else None) as pool:
        yield from pool.imap(go, tasks, chunksize=1)
