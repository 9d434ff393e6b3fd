"""The page of rules of `worm3d study control`, made from the tables that it runs: `scenes/studies/bench/CONTROL.md`.

python tests/benchmarks/control_page.py > scenes/studies/bench/CONTROL.md
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

from scenes.records.text import markdown_table
from scenes.studies.bench.control_error import MIN_RUN_DURATION_S, STARTUP_TIME_S, WINDOW
from scenes.studies.bench.control_report import LOST_TRIAL_EXIT_CODE, Options
from scenes.studies.bench.control_score import FLOOR
from scenes.studies.bench.control_trials import CLASSES, GROUPS, QUICK, SHORT, SPEEDS

PAGE = """# A benchmark of controllers for worm robots

A controller is to make worms that it does not know keep to speeds, headings and paths, by noisy and late sensors.
`worm3d study control` draws the trials from a seed, runs them on the full 3D plant (contacts that stick and slip,
actuators with a lag), and gives each controller a score. Results stand in [control](../../../control/README.md). This
page is made from the tables of the program by `python tests/benchmarks/control_page.py`.

    worm3d study control --workers 2                                  # {trials} trials of seed 0
    worm3d study control --controller my_module:MyController --seed 7 # one of yours beside those that ship
    worm3d study control --trial pipe --trial 3 -o run.duration_s=90  # some trials, and something changed in all
    worm3d study control --show                                       # the trials, as commands that run them

## Rules

1. Trial k of seed S is the same for all controllers and on all machines. Tune on any seeds, and say which; a judge
   takes a seed that nobody has used, best a number of many digits. `--seeds N` takes the seeds S to S + N - 1.
2. A controller gets a `control.task.ControlTask`: the worm, the reference, what steers, the control period, the quality
   of the sensors, and the map of the *default* worm's waves, whatever the worm is (`-o controller.map=own` gives all of
   them another map). Nobody is told of unequal chambers, friction and slope.
3. At each step of 10 ms it takes a measurement and returns contractions and hinges. It begins each trial anew, with one
   set of gains for all trials.
4. A trial is lost, and its error is 1, where the run does not come to its end; where a controller that is not built on
   `control.loop.WaveController` raises an exception, or returns what is no command; where it commands forces of the
   chambers, or brings a sensor of its own; and where its median control step takes longer than the control period (on
   a machine that does nothing else: such a trial is run again if the command is started again on the same --out). A
   99th percentile above the control period is reported, and loses nothing.
5. State what a controller was tuned or trained on, with how many runs, and how long that took.

The command ends with {failed} if a trial was lost, else with 0. `--quick` runs {quick}, for {short} each, which
says little.

## Error

The error of a run is one number: the distance of the worm from the place where it ought to be, over the wanted way.

* The way along the path is averaged over windows of {window:g} s: two waves at 0.8 Hz, whose rocking then averages out.
  The window is the same for all, and what a controller says of its waves counts nowhere.
* *Ahead* is the way gained from one window to the next, less the way D that is wanted in that time. The worm
  misses its place by the root of the squares of that and of its offset from the path. Where the task is a heading, the
  miss is the distance between two ways: the worm's, along its own heading, and the wanted way along the wanted heading.
* error = rms of this miss over rms of D, at most 1. It counts from {shortest:g} s on, so that no window reaches
  into the first {start:g} s.

| a worm that | has the error |
|---|---|
| stands | 1 |
| goes at the share a of the speed asked for, along its path | 1 - a |
| goes at the speed asked for, at the distance e beside its path | e/D; 0.5 for 0.1 m at 0.08 m/s |
| goes at the speed asked for, turned from its heading by b | 2 sin(b/2) |
| does well for three quarters of the time, then stands | 0.5 |
| runs away, goes to and fro, or in circles | 1 |

## Score

    score = geometric mean over all trials of E / (E of pi_los),   E = max(error, {floor:g})

so that line-of-sight with its default gains has 1, and less is better. Beside it stand the median and the worst error,
the trials lost, the *real-time factor* (seconds simulated in a second, by simulator and controller together) and the
*control step*: all that a controller computes in a control period, measured around it. What a controller computes
before the first step counts nowhere.

That a worm at rest, a slow one, a constant wave, and controllers that lie, stop, raise, weave or pull with forces have
worse scores than line-of-sight is a test (`tests/scenes/studies/bench/test_bench_honest.py`). A controller is Python in
the process of the simulator: one that reads or changes the simulator's objects, tries the family's seeds for the trial
that it is in, or computes in other threads, is not kept from it. Read the code of a controller before you believe its
score.

## Trials

{count} classes of tasks take turns. All last 60 s; speeds are {least:g} to {most:g} m/s.

{classes}

The rest is drawn for every trial:

{drawn}
"""


def page() -> str:
    """Return the page."""
    return PAGE.format(
        trials=Options().trials,
        failed=LOST_TRIAL_EXIT_CODE,
        quick=" and ".join(f"a {name}" for name in QUICK),
        short=SHORT[0].partition("=")[2] + " s",
        window=WINDOW,
        start=STARTUP_TIME_S,
        shortest=MIN_RUN_DURATION_S,
        floor=FLOOR,
        count=len(CLASSES),
        least=SPEEDS[0],
        most=SPEEDS[1],
        classes="\n".join(markdown_table(("class", "task"), _classes())),
        drawn="\n".join(markdown_table(("what", "share of the trials", "key", "from", "to"), _drawn())),
    )


def _classes() -> Iterator[tuple[str, str]]:
    for name, maker in CLASSES.items():
        yield name, str(maker.__doc__).removeprefix("Yield ").removesuffix(".")


def _drawn() -> Iterator[tuple[str, ...]]:
    for group in GROUPS:
        share = "all" if group.share == 1.0 else f"{group.share:.0%}"
        for switch in group.switch:
            yield group.says, share, f"`{switch}`", "", ""
        for each in group.ranges:
            yield group.says, share, f"`{each.key}`", f"{each.least:g}", f"{each.most:g}"


if __name__ == "__main__":
    sys.stdout.write(page())
