"""Tests run what users run, louder: floating point errors raise, plots need no screen; a browser looks at pages."""

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

mpl.use("Agg")

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
FLAGS = (
    *("--headless", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update"),
    *("--disable-sync", "--virtual-time-budget=4000", "--window-size=900,600", "--enable-logging=stderr"),
    # The network is off: no name is found, and what goes out goes to a port where nobody is.
    *("--proxy-server=127.0.0.1:9", "--host-resolver-rules=MAP * ~NOTFOUND"),
)
WIDE, HIGH = 900, 600

Picture = NDArray[np.int64]


class Browser:
    """Opens a page and returns what is seen."""

    def __init__(self, program: str, folder: Path) -> None:
        self.program, self.folder = program, folder
        self.opened = 0

    def _run(self, page: Path, state: str, *more: str) -> str:
        self.opened += 1
        home = self.folder / f"home-{self.opened}"
        command = [self.program, *FLAGS, f"--user-data-dir={home}", *more]
        done = subprocess.run([*command, f"{page.as_uri()}#{state}"], capture_output=True, text=True, timeout=120)
        assert "Uncaught" not in done.stderr, done.stderr
        assert "THREE." not in done.stderr, done.stderr
        return done.stdout

    def picture(self, page: Path, state: str) -> Picture:
        """Return red, green, blue of every pixel, shape (high, wide, 3)."""
        target = self.folder / f"{self.opened}.png"
        self._run(page, state, f"--screenshot={target}")
        with Image.open(target) as image:
            return np.asarray(image.convert("RGB"), dtype=np.int64)

    @staticmethod
    def scene(picture: Picture) -> Picture:
        """Return the part beside the panel and above the bar."""
        return picture[: HIGH - 60, 185:]

    def worm_share(self, picture: Picture) -> float:
        """Return the share of the scene that is red to skin-coloured, as chambers are."""
        red, green, blue = np.moveaxis(self.scene(picture), -1, 0)
        like_chambers = (red > 130) & (red - blue > 35) & (red - green > 15) & (green < 2 * blue + 20)
        return float(like_chambers.mean())

    def document(self, page: Path, state: str) -> str:
        """Return the page as it stands after a while."""
        return self._run(page, state, "--dump-dom")


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Browser:
    program = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if program is None:
        pytest.skip(f"no browser on this machine: none of {', '.join(BROWSERS)} was found")
    return Browser(program, tmp_path_factory.mktemp("browser"))


@pytest.fixture(autouse=True)
def _floating_point_errors_raise() -> Iterator[None]:
    with np.errstate(divide="raise", over="raise", invalid="raise"):
        yield
