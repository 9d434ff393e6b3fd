"""Pictures per second, time from key to picture, and growth of memory of `worm3d play`, in a headless Chromium.

    PYTHONPATH=.:tests/worm3d python tests/benchmarks/play.py [SCENE] [--size 1280x800] [--minutes 3] [--speed 1]

A key to picture is the time from a key that takes a step of the held run to the second frame of the browser after the
page got the answer. Memory is measured after garbage collection, every fifth of the time.
"""

from __future__ import annotations

import argparse
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import devtools
from measuring import say

PICTURES = """new Promise(done => {
  let count = 0, last = "";
  const begin = performance.now();
  (function look() {
    const now = document.documentElement.dataset.time, passed = performance.now() - begin;
    if (now !== last) { count++; last = now; }
    if (passed > 5000) done(1000 * count / passed); else requestAnimationFrame(look);
  })();
})"""

LATENCY = """window.taken = [];
addEventListener("keydown", () => {
  const begin = performance.now(), page = document.documentElement, before = page.dataset.heard;
  (function look() {
    requestAnimationFrame(() => {
      if (page.dataset.heard === before) look();
      else requestAnimationFrame(() => taken.push(performance.now() - begin));
    });
  })();
}, true)"""

PROGRAM = "from scenes.commands.cli import main; main()"


def resident(pid: int) -> float:
    """Return the resident memory of a process and its children [MB]."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    own = next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmRSS"))
    return own + sum(resident(int(child)) for child in children)


def heap(browser: devtools.Chromium) -> float:
    """Return the memory of the page's script after garbage collection [MB]."""
    browser.ask("HeapProfiler.collectGarbage")
    metrics = {each["name"]: each["value"] for each in browser.ask("Performance.getMetrics")["metrics"]}
    return float(metrics["JSHeapUsedSize"]) / 1e6


def main() -> None:
    """Play a scene and print the measured values."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("scene", nargs="?", default="path_line")
    parser.add_argument("--size", default="1280x800")
    parser.add_argument("--minutes", type=float, default=3.0)
    parser.add_argument("--speed", default="1")
    asked = parser.parse_args()
    wide, high = map(int, asked.size.split("x"))
    command = [sys.executable, "-c", PROGRAM, "play", asked.scene, "--no-open", "--speed", asked.speed]
    found = devtools.program()
    assert found is not None, "needs Chromium"
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process,
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as home,
        devtools.Chromium(found, Path(home), size=(wide, high)) as browser,
    ):
        assert process.stdout is not None
        browser.open(process.stdout.readline().split(" at ")[1].split(";")[0])
        browser.ask("Performance.enable")
        time.sleep(10.0)  # the page finds the number of pixels that it can draw
        rate = [browser.value(PICTURES) for _ in range(3)]
        ratio = browser.value("viewer.renderer.getPixelRatio()")
        say(f"pictures per second: {', '.join(f'{each:.1f}' for each in rate)} (pixel ratio {ratio:.2f})")
        browser.press(" ")
        browser.value(LATENCY)
        for _ in range(20):
            time.sleep(0.3)
            browser.press(".")
        time.sleep(0.5)
        taken = browser.value("taken")
        say(f"key to picture: median {statistics.median(taken):.0f} ms, largest {max(taken):.0f} ms of {len(taken)}")
        browser.press(" ")
        for _ in range(6):
            said = f"t = {browser.value('document.documentElement.dataset.time')} s: "
            say(f"{said}programs {resident(process.pid):.1f} MB, script of the page {heap(browser):.1f} MB")
            time.sleep(12.0 * asked.minutes)
        process.send_signal(signal.SIGINT)


if __name__ == "__main__":
    main()
