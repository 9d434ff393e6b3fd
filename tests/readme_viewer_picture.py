"""Draw the README's pictures of pages, with a browser: `.venv/bin/python tests/readme_viewer_picture.py`."""

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

OUT = Path(__file__).parents[1] / ".readme"
PICTURES = {
    "viewer.jpg": (("flat", "-o", "gait.hinge_deg=30"), "t=5&bare=1", (260, 200, 2060, 1040)),
    "pipe.jpg": (("pipe_bend", "-o", "run.duration_s=10"), "t=9&bare=1", (0, 40, 1800, 1000)),
}
"""What is run, what is seen of it, and the part that is kept, in pixels: two for each of the page."""
SIZE = (1100, 560)
FLAGS = (
    *("--headless", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update"),
    *("--disable-sync", "--virtual-time-budget=4000", "--force-device-scale-factor=2"),
)


def main() -> None:
    worm3d = str(Path(sys.executable).parent / "worm3d")
    for name, (scene, state, part) in PICTURES.items():
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run([worm3d, "run", *scene, "--out", f"{folder}/run", "--quiet"], check=True)
            page = Path(folder, "run", "viewer.html").as_uri()
            window = f"--window-size={SIZE[0]},{SIZE[1]}"
            places = [f"--user-data-dir={folder}/home", f"--screenshot={folder}/seen.png"]
            subprocess.run(["chromium", *FLAGS, window, *places, f"{page}#{state}"], check=True, capture_output=True)
            with Image.open(f"{folder}/seen.png") as seen:
                cut = seen.convert("RGB").crop(part)
        cut.resize((cut.width // 2, cut.height // 2), Image.Resampling.LANCZOS).save(
            OUT / name, quality=88, optimize=True
        )


if __name__ == "__main__":
    main()
