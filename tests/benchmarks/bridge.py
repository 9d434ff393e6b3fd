"""The bridge to a simulated robot on this machine: deadlines kept, and the path compared with the simulation.

    python tests/benchmarks/bridge.py [--minutes 10] [--scene path_s_curve] [-o KEY=VALUE ...]

The controller of the scene drives a simulated robot in another process over UDP, with a delay of 1 ms, a jitter of 5 ms
and a loss of 1 % each way; `-o` gives the robot other parameters than the controller believes. Three lines follow:

    deadlines   share of the ticks of 10 ms whose packet left within the tick; 99th percentile of the lateness; ticks
                for which the controller was late; bar: 99.9 %
    path        rms distance of the true centre of mass, averaged over a wave, from the path [body lengths], over the
                same figure of a simulation of the same length; the first 10 s are left out; bar: 1.5
    link        round trip, samples and sessions

No other program should run at the same time. Without the right to real-time priorities (root, or a limit `rtprio`), the
deadlines are those of usual processes.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from measuring import say

from control.tracking.paths import offset, track
from scenes.models.control.reference import reference_of
from scenes.models.loading import Scene, load_scene
from scenes.records.record import Record
from scenes.records.store import load
from scenes.running.runner import simulate
from worm3d.values.period_means import averaged

PORT = 7411
LINE = ("--delay", "0.001", "--jitter", "0.005", "--loss", "0.01")
WAVE, DROPPED = 1.25, 10.0
PROGRAM = (sys.executable, "-m", "scenes.commands.cli")


def off_path(record: Record, scene: Scene, duration: float) -> float:
    """Return the rms distance of the averaged centre of mass from the path [body lengths]."""
    time, path = record["time"], reference_of(scene.settings).path
    assert path is not None
    step = float(time[1] - time[0])
    window = round(WAVE / step)
    places = averaged(record["com"], window)[:, :2]
    middle = time[: len(places)] + WAVE / 2.0
    kept = (middle > DROPPED) & (middle < duration)
    return (
        float(np.sqrt(np.mean(offset(path, places[kept], track(path, places[kept])) ** 2)))
        / scene.settings.worm.length_m
    )


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--scene", default="path_s_curve")
    parser.add_argument("-o", action="append", default=[], metavar="KEY=VALUE")
    given = parser.parse_args()
    duration = 60.0 * given.minutes
    last = ("-o", f"run.duration_s={duration!r}")
    with tempfile.TemporaryDirectory() as folder:
        true, driven = Path(folder) / "true", Path(folder) / "driven"
        changes = [part for each in given.o for part in ("-o", each)]
        address = f"udp://127.0.0.1:{PORT}"
        robot = subprocess.Popen(
            [*PROGRAM, "robot", given.scene, *last, *changes, *LINE, "--listen", address, "--out", str(true)],
            stderr=subprocess.PIPE,
            text=True,
        )
        assert robot.stderr is not None
        say(robot.stderr.readline().rstrip())
        subprocess.run([*PROGRAM, "bridge", given.scene, *last, "--to", address, "--out", str(driven)], check=True)
        robot.send_signal(signal.SIGINT)
        say(robot.stderr.read().rstrip())
        assert robot.wait() == 0, "the robot failed"
        summary, seen = json.loads((driven / "summary.json").read_text()), load(true)
        scene = load_scene(given.scene, [f"run.duration_s={duration!r}"])
        found, simulated = (off_path(each, scene, duration) for each in (seen, simulate(scene)))
    kept, late, held = (summary[name] for name in ("deadlines_kept", "lateness_ms_p99", "commands_held"))
    say(f"deadlines   {100 * kept:.3f} % kept, 99 % within {late:.2f} ms; {held} ticks without a new command")
    say(f"path        {found:.5f} body lengths, {found / simulated:.2f} times the {simulated:.5f} of the simulation")
    trips = f"{summary['round_trip_ms_p50']:.1f} ms (99 %: {summary['round_trip_ms_p99']:.1f} ms)"
    say(f"link        round trip {trips}; {summary['samples']} samples, {summary['sessions']} session(s)")


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main()
