"""The page of rules of `worm3d bench control`, made from the tables that it runs: `scenes/studies/bench/CONTROL.md`.

python tests/benchmarks/control_page.py > scenes/studies/bench/CONTROL.md
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator

from control.sensing.sensors import QUANTITIES, Channel
from scenes.models.loading import load_scene
from scenes.records.text import markdown_table
from scenes.studies.bench.control import BLIND, METRICS
from scenes.studies.bench.control_bars import BARS, RIVALS, SHARE
from scenes.studies.bench.control_report import BAR_BROKEN, FAILED
from scenes.studies.bench.control_score import FLOORS, LOST, OFF_SPEED
from scenes.studies.bench.control_trials import FULL, RETUNED, Trial

SEEDS = 5
INTRO = """# A benchmark of controllers for worm robots

A worm of six segments on a full 3D plant (contacts that stick and slip, actuators with a lag) is to keep to speeds,
headings and paths. This page has the rules; `worm3d bench control` runs them and writes the results, of which
[control](../../../control/README.md) has a table. Made from the tables of the program by
`python tests/benchmarks/control_page.py`.

## Rules

1. A controller gets a `control.task.ControlTask`: the worm, the reference, the identified map of its waves, what
   steers, the control period, and the quality of the sensors. It never sees the simulator's state, nor the name of the
   trial.
2. At each step of 10 ms it takes a measurement and returns contractions and hinges. One set of gains for all trials.
3. A run lasts as long as its scene says, on the plant as it ships. A controller loses a trial that it does not finish
   with every seed, or in which it raises an exception. It loses a trial that is about an offset or a heading if the
   worm does not go at about the speed asked for ({off}).
4. Tune on seeds from 10 on; seeds 0 to {last} are run here, and 40 to 44 in `tests/benchmarks/closed_loop_bars.py`.
5. State what a controller was tuned or trained on, with how many runs, and how long that took.

A controller of your own enters by its name, beside those that ship, with a line for each:

    worm3d bench control --controller my_module:MyController
    worm3d bench control --controller my_module:MyController --trial path_circle --trial corner --seeds 1

`mpc` and `pi_los` are run with {seeds} seeds, `{blind}`, which looks at nothing, with one.

The command ends with {failed} if a run did not come to its end or a controller of yours raised an exception, or else
with {broken} if a bar of the MPC (below) is not kept, or else with 0. Bars are for runs without `--controller`,
`--trial` and `--quick`.
"""
SCORE = """## Score

With E the error that a trial is about, of the worst seed, and no less than what can be told apart ({floors}),

    score = geometric mean over all trials of E / (E of pi_los)

so that line-of-sight has 1; a trial that was lost counts {lost:g}, and none counts more. Errors are means over a moving
window of one commanded wave; the first three waves are left out (`control/tracking/metrics.py`). A control step is all
that a controller computes in a control period, 99th percentile, on one core.
"""


def page() -> str:
    """Return the page."""
    floors = ", ".join(f"{METRICS[name].text(value)}" for name, value in FLOORS.items())
    off = " or ".join(f"{METRICS[name].says} from {most:.0%} on" for name, most in OFF_SPEED.items())
    lines = (
        INTRO.format(seeds=SEEDS, last=SEEDS - 1, blind=BLIND, off=off, failed=FAILED, broken=BAR_BROKEN),
        "## Trials\n",
        *markdown_table(("trial", "scene", "changed", "lasts", "about"), map(_trial, FULL)),
        "\n## Sensors\n",
        *markdown_table(("channel", "noise", "samples a second"), _sensors()),
        "\nUnless a trial says otherwise. Errors are normal; each channel has its own generator, seeded by the seed.\n",
        SCORE.format(floors=floors, lost=LOST),
        "## What the MPC is held to\n",
        *markdown_table(("trial", "what", "at most"), _bars()),
        f"\nA control step may take {SHARE:.0%} of the control period. Line-of-sight has its default gains here;\n"
        "retuned for a trial, by 12 runs with seed 10 (reach and gain of the heading), it has\n",
        *markdown_table(("trial", "gains"), ((name, f"`{' '.join(keys)}`") for name, keys in RETUNED.items())),
    )
    return "\n".join(lines) + "\n"


def _trial(trial: Trial) -> tuple[str, ...]:
    settings = load_scene(trial.scene, trial.overrides).settings
    changed = ", ".join(f"`{each}`" for each in trial.overrides) or "-"
    link = f"[{trial.scene}](../../{trial.scene}.toml)"
    return trial.name, link, changed, f"{settings.run.duration_s:g} s", METRICS[trial.metric].says


def _sensors() -> Iterator[tuple[str, ...]]:
    for name, quantity in QUANTITIES.items():
        if quantity.standard or name == "heading":
            when = "" if quantity.standard else " (only where a trial has it)"
            yield f"{quantity.meaning}{when}", _noise(quantity.default, quantity.unit), _rate(quantity.default)


def _noise(channel: Channel, unit: str) -> str:
    if unit == "rad":
        return f"{math.degrees(channel.noise):.3g} deg"
    return f"{1000.0 * channel.noise:g} mm" if unit == "m" else f"{channel.noise:g}"


def _rate(channel: Channel) -> str:
    return "every step" if math.isinf(channel.rate) else f"{channel.rate:g}"


def _bars() -> Iterator[tuple[str, ...]]:
    for bar in BARS:
        yield bar.trial, bar.says, METRICS[bar.metric].text(bar.most)
    for trial, share in RIVALS.items():
        yield (
            trial,
            "rms offset from the path",
            "line-of-sight's" if share == 1.0 else f"{share:.2g} of line-of-sight's",
        )


if __name__ == "__main__":
    sys.stdout.write(page())
