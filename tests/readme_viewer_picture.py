"""Draw the README's picture of the page, with a browser: `.venv/bin/python tests/readme_viewer_picture.py`."""

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

OUT = Path(__file__).parents[1] / ".readme" / "viewer.jpg"
SEEN = "t=5&bare=1"
SIZE = (1100, 560)
CUT = (260, 200, 2060, 1040)
"""In pixels of the screen, of which a pixel of the page has two."""

FLAGS = (
    *("--headless", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update"),
    *("--disable-sync", "--virtual-time-budget=4000", "--force-device-scale-factor=2"),
)


def main() -> None:
    worm3d = str(Path(sys.executable).parent / "worm3d")
    with tempfile.TemporaryDirectory() as folder:
        run = ["run", "flat", "-o", "gait.hinge_deg=30", "--out", f"{folder}/turn", "--quiet"]
        subprocess.run([worm3d, *run], check=True)
        page = Path(folder, "turn", "viewer.html").as_uri()
        window = f"--window-size={SIZE[0]},{SIZE[1]}"
        places = [f"--user-data-dir={folder}/home", f"--screenshot={folder}/seen.png"]
        subprocess.run(["chromium", *FLAGS, window, *places, f"{page}#{SEEN}"], check=True, capture_output=True)
        with Image.open(f"{folder}/seen.png") as seen:
            cut = seen.convert("RGB").crop(CUT)
        cut.resize((cut.width // 2, cut.height // 2), Image.Resampling.LANCZOS).save(OUT, quality=88, optimize=True)


if __name__ == "__main__":
    main()
