"""Draw the pictures of pages in the README and in the guide on worlds, with a browser.

.venv/bin/python tests/readme_viewer_picture.py
"""

import io
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

sys.path.insert(0, str(Path(__file__).parent / "worm3d"))
import devtools

ROOT = Path(__file__).parents[1]
PICTURES = {
    ".readme/viewer.jpg": (("flat", "-o", "gait.hinge_deg=30"), "t=5&bare=1", (260, 200, 2060, 1040)),
    ".docs/_static/pipe.jpg": (("pipe_bend", "-o", "run.duration_s=10"), "t=9&bare=1", (0, 40, 1800, 1000)),
}
"""What is run, what is seen of it, and the part that is kept, in pixels: two for each of the page."""
SIZE = (1100, 560)


def main() -> None:
    program = devtools.program()
    assert program is not None, f"no browser on this machine: none of {', '.join(devtools.PROGRAMS)} was found"
    worm3d = str(Path(sys.executable).parent / "worm3d")
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder,
        devtools.Chromium(program, Path(folder, "home"), size=SIZE, scale=2.0) as browser,
    ):
        for name, (scene, state, part) in PICTURES.items():
            out = Path(folder, Path(name).name)
            subprocess.run([worm3d, "run", *scene, "--out", str(out), "--quiet"], check=True)
            browser.open(out / "viewer.html", state)
            with Image.open(io.BytesIO(browser.png())) as seen:
                cut = seen.convert("RGB").crop(part)
            half = cut.resize((cut.width // 2, cut.height // 2), Image.Resampling.LANCZOS)
            half.save(ROOT / name, quality=88, optimize=True)


if __name__ == "__main__":
    main()
