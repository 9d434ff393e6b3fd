"""Tests run what users run, louder: floating point errors raise, plots need no screen; a browser looks at pages."""

import os
from collections.abc import Generator, Iterator
from pathlib import Path

import devtools
import matplotlib as mpl
import numpy as np
import pytest
from devtools import HIGH, Chromium, Picture

from planar.linkage import Run as LinkageRun
from planar.published import Run as PublishedRun
from worm3d.running.plant import Plant

mpl.use("Agg")


def pytest_configure() -> None:
    """Give linear algebra of each worker one thread: workers take all cores, and more threads wait for each other."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect tests without any simulation: each worker would make all of them, whichever tests it runs."""

    def refuse(*_: object, **__: object) -> None:
        raise RuntimeError("a module of tests simulates when it is imported; let a fixture do so")

    with pytest.MonkeyPatch.context() as patch:
        for kind in (Plant, LinkageRun, PublishedRun):
            patch.setattr(kind, "__init__", refuse)
        return (yield)


class Browser(Chromium):
    """Opens a page and returns what is seen."""

    def look(self, page: Path, state: str) -> Picture:
        """Open a page in a state, and return what is seen, shape (high, wide, 3)."""
        self.open(page, state)
        seen = self.picture()
        assert not self.errors, self.errors
        return seen

    @staticmethod
    def scene(picture: Picture) -> Picture:
        """Return the part beside the panel and above the bar."""
        return picture[: HIGH - 60, 185:]

    def worm_share(self, picture: Picture) -> float:
        """Return the share of the scene that is red to skin-coloured, as the worm is."""
        red, green, blue = np.moveaxis(self.scene(picture), -1, 0)
        like_worm = (red > 130) & (red - blue > 35) & (red - green > 15) & (green < 2 * blue + 20)
        return float(like_worm.mean())


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    program = devtools.program()
    if program is None:
        pytest.skip(f"no browser on this machine: none of {', '.join(devtools.PROGRAMS)} was found")
    with Browser(program, tmp_path_factory.mktemp("browser")) as started:
        yield started


@pytest.fixture(autouse=True)
def _floating_point_errors_raise() -> Iterator[None]:
    with np.errstate(divide="raise", over="raise", invalid="raise"):
        yield
