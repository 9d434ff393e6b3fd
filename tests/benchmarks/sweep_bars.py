"""Bars of sweeps on workers, through the command: `python tests/benchmarks/sweep_bars.py [BAR ...] [--cases N]`.

    worker     one of two workers is killed half-way: all cases end well, none that was finished is run again
    driver     `worm3d sweep` is killed half-way: started again it runs the rest only
    scheduler  a running scheduler is killed: a clear end within seconds, and the same command runs the rest
    speedup    two workers do at least 1.6 times as much as one
    short      cases of 5 s simulated take at most twice the time of their bare simulations on two threads

Takes a quarter of an hour with 200 cases; nothing else should run meanwhile.
"""

from __future__ import annotations

import argparse
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import psutil

BIN = Path(sys.executable).parent
LONG = "run.duration_s=200"
"""Simulated time of a case that takes a second or more."""
LEAST_SPEEDUP, MOST_OF_BARE = 1.6, 2.0
SOON = 10.0
"""Longest time in which the sweep ends after its scheduler [s]."""

Stamps = dict[str, tuple[int, int]]

kept = True
"""Whether all bars were kept so far."""


def command(out: Path, cases: int, *options: str) -> list[str]:
    vary = f"gait.period_s=2:4:{cases}"
    return [str(BIN / "worm3d"), "sweep", "flat", "--vary", vary, "--quiet", "--out", str(out), *options]


def stamps(out: Path) -> Stamps:
    """Return what tells a case's file from one that has been written again."""
    return {path.name: (path.stat().st_ino, path.stat().st_mtime_ns) for path in (out / "cases").glob("*.json")}


def require(truth: bool, sentence: str) -> None:
    global kept
    sys.stdout.write(f"{'kept  ' if truth else 'BROKEN'}  {sentence}\n")
    sys.stdout.flush()
    kept = kept and truth


def wait_until(out: Path, number: int, process: subprocess.Popen[bytes]) -> Stamps:
    """Wait until that many cases have ended."""
    while len(found := stamps(out)) < number and process.poll() is None:
        time.sleep(0.1)
    return found


def require_complete(out: Path, cases: int, earlier: Stamps, code: int, what: str) -> None:
    later = stamps(out)
    again = [name for name, stamp in earlier.items() if later.get(name) != stamp]
    strays = [path.name for path in (*out.iterdir(), *(out / "cases").iterdir()) if path.name.startswith(".")]
    ok = code == 0 and len(later) == cases and not again and not strays
    require(ok, f"{what}: code {code}, {len(later)} of {cases} cases, {len(again)} run again, stray files: {strays}")


def worker(folder: Path, cases: int) -> None:
    process = subprocess.Popen(command(folder, cases, "-o", LONG, "--workers", "2"))
    earlier = wait_until(folder, cases // 2, process)
    workers = [each for each in psutil.Process(process.pid).children(recursive=True) if each.cpu_times().user > 3.0]
    workers[0].kill()
    require_complete(folder, cases, earlier, process.wait(), f"one of {len(workers)} workers killed")


def driver(folder: Path, cases: int) -> None:
    begin = command(folder, cases, "-o", LONG, "--workers", "2")
    process = subprocess.Popen(begin)
    wait_until(folder, cases // 2, process)
    process.kill()
    process.wait()
    time.sleep(2.0)
    earlier = stamps(folder)
    code = subprocess.run(begin).returncode
    require_complete(folder, cases, earlier, code, f"driver killed after {len(earlier)} cases")


@contextmanager
def dask(*options: str) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen([BIN / "dask", *options], stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.send_signal(signal.SIGTERM)
        process.communicate()


def scheduler(folder: Path, cases: int) -> None:
    with ExitStack() as stack:
        options = ("--host", "127.0.0.1", "--port", "0", "--dashboard-address", "127.0.0.1:0")
        server = stack.enter_context(dask("scheduler", *options))
        assert server.stderr is not None
        address = next(found[0] for line in server.stderr if (found := re.search(r"tcp://127\S+:\d+", line)))
        stack.enter_context(dask("worker", address, "--host", "127.0.0.1", "--nthreads", "1", "--nworkers", "2"))
        process = subprocess.Popen(command(folder, cases, "-o", LONG, "--scheduler", address), stderr=subprocess.PIPE)
        wait_until(folder, cases // 2, process)
        server.kill()
        begun = time.monotonic()
        said = process.communicate()[1].decode()
        seconds = time.monotonic() - begun
    clear = process.returncode == 1 and said.count("\n") == 1 and "the scheduler has ended" in said
    require(clear and seconds < SOON, f"scheduler killed: code {process.returncode} after {seconds:.1f} s: {said!r}")
    earlier = stamps(folder)
    code = subprocess.run(command(folder, cases, "-o", LONG, "--workers", "2")).returncode
    require_complete(folder, cases, earlier, code, f"after the scheduler's end with {len(earlier)} cases")


def speedup(folder: Path, cases: int) -> None:
    seconds = {}
    for workers in (1, 2):
        out = folder / str(workers)
        subprocess.run(command(out, cases, "-o", LONG, "--workers", str(workers)), check=True)
        times = sorted(stamp[1] for stamp in stamps(out).values())
        seconds[workers] = (times[-1] - times[workers]) * 1e-9 / (len(times) - workers)  # without start and end
    ratio = seconds[1] / seconds[2]
    text = f"two workers do {ratio:.2f} times as much as one ({seconds[1]:.2f} s and {seconds[2]:.2f} s a case)"
    require(ratio >= LEAST_SPEEDUP, text)


def short(folder: Path, cases: int) -> None:
    """Five times as many cases, of 5 s simulated."""
    import worm3d
    from scenes.models.loading import load_scene
    from scenes.models.worm.build import simulate

    number = 5 * cases
    periods = [2.0 + 2.0 * k / (number - 1) for k in range(number)]
    scenes = [load_scene("flat", ["run.duration_s=5.0", f"gait.period_s={period!r}"]).settings for period in periods]

    def bare(scene: Any) -> worm3d.Result:
        return simulate(scene, lambda done: True)

    bare(scenes[0])
    begun = time.monotonic()
    with ThreadPoolExecutor(2) as threads:
        for _ in threads.map(bare, scenes):
            pass
    alone = time.monotonic() - begun
    begun = time.monotonic()
    code = subprocess.run(command(folder, number, "-o", "run.duration_s=5", "--workers", "2")).returncode
    swept = time.monotonic() - begun
    text = f"{number} cases of 5 s: {swept:.1f} s swept, {alone:.1f} s bare on two threads, {swept / alone:.2f} times"
    require(code == 0 and swept <= MOST_OF_BARE * alone, text)


BARS = {each.__name__: each for each in (worker, driver, scheduler, speedup, short)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bars", nargs="*", choices=[*BARS, []], metavar="BAR", help="default: all")
    parser.add_argument("--cases", type=int, default=200, help="number of cases, default 200")
    options = parser.parse_args()
    for name in options.bars or BARS:
        with tempfile.TemporaryDirectory() as folder:
            BARS[name](Path(folder) / name, options.cases)
    sys.exit(0 if kept else 1)


if __name__ == "__main__":
    main()
