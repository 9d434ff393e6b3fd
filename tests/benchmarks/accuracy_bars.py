"""Bars of accuracy on request: `python tests/benchmarks/accuracy_bars.py [CASE ...] [--wavelength] [--limit]`.

Runs six cases on which fixed steps are known to be off, and twelve others, from three phases of their gait, 10 s each,
at accuracy 0.01. How errors are estimated was chosen on the same cases from other phases (0, 1/3, 2/3). The truth of a
case is what two integrators agree on: BDF2 at a fixed step of 50 µs, and variable-step BDF2 that is allowed a 120th of
the usual error in each step. Where they differ by more than 0.1 % of max(|distance|, 0.1 L) the case says so ("?"), and
is judged by what it differs by from the nearer one.

    error     of the distance, in percent of max(|distance|, 0.1 L): at most 1
    estimate  the same of `error_estimate.distance`; |error| <= 2 estimate in 95 %, median of their ratio at most 5
    factor    simulated over computing time, all runs of the request together

--wavelength prints how smooth the distance is over the wavelength, --limit where turning runs lead as steps become
short: variable steps, fixed BDF2, and implicit Euler, the last two extrapolated.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from calibration import calibrate

from scenes.models.loading import load_scene
from scenes.models.worm.build import problem_of
from worm3d import Result, Status
from worm3d.running import accuracy as runs
from worm3d.running.actuation import Command, Commands
from worm3d.running.problem import Problem
from worm3d.running.run import Run

ACCURACY, SECONDS, PHASES = 0.01, 10.0, (1.0 / 6.0, 1.0 / 2.0, 5.0 / 6.0)
FINE, FINER = 5e-5, 120.0
AGREE = 0.001

SIX = {
    "straight": ("flat",),
    "period 0.5 s": ("flat", "gait.period_s=0.5"),
    "damping 5 ms": ("flat", "worm.kelvin_voigt_time_s=0.005"),
    "bias 0.6": ("flat", "gait.bias=0.6"),
    "slope 9 deg": ("flat", "world.slope_deg=9"),
    "segment driven": ("flat", "gait.kind=segment_driven"),
}
TWELVE = {
    "hinges 30 deg": ("flat", "gait.hinge_deg=30"),
    "steered turn": ("turn",),
    "slope -5 deg": ("flat", "world.slope_deg=-5"),
    "slope_15": ("slope_15",),
    "pipe_straight": ("pipe_straight",),
    "pipe_bend": ("pipe_bend", "run.record_every=1"),
    "pipe_narrowing": ("pipe_narrowing", "run.record_every=1"),
    "inchworm": ("inchworm",),
    "sidewinding": ("sidewinding", "run.record_every=1"),
    "ten segments": ("flat", "worm.segments=10"),
    "viscous friction": ("flat", "friction.law=viscous"),
    "pneumatic": ("flat", "actuator.kind=pneumatic"),
}
CASES = SIX | TWELVE


def say(line: str) -> None:
    """Print a line."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


class Shifted:
    """A gait from another of its phases on."""

    def __init__(self, gait: Any, phase: float) -> None:
        self.gait, self.period = gait, getattr(gait, "period", getattr(gait, "T_wave", None))
        self.late = phase * self.period

    def bind(self, worm: Any) -> Callable[[float], Command]:
        bound, late = self.gait.bind(worm), self.late

        class Late:
            def __call__(self, t: float) -> Command:
                command: Command = bound(t + late)
                return command

            def commands(self, times: Any) -> Commands:
                found: Commands = bound.commands(times + late)
                return found

        return Late()


def problem(case: tuple[str, ...], phase: float = 0.0, seconds: float = SECONDS) -> Problem:
    """Return a case as a problem."""
    scene: Any = load_scene(case[0], (f"run.duration_s={seconds}", *case[1:])).settings
    made = problem_of(scene)
    return replace(made, actuation=Shifted(made.actuation, phase))


def finished(result: Result) -> Result:
    """Return a result that reached its end."""
    if result.status is not Status.DONE:
        raise RuntimeError(result.stop.sentence)
    return result


def fixed(of: Problem, dt: float, **changes: Any) -> Result:
    """Return a run with steps of a fixed length."""
    return finished(Run(replace(of, dt=dt, record_every=max(1, round(0.01 / dt)), **changes)).finish())


def variable(of: Problem, allowed: float) -> Result:
    """Return a run whose steps are allowed an error [m]."""
    return finished(Run(of, allowed=allowed).finish())


def judge(names: list[str]) -> None:
    """Print each case, and what becomes of the bars."""
    say(f"calibration {calibrate():.3f} us a pass")
    ratios, worst, slowest = [], 0.0, np.inf
    for name in names:
        for phase in PHASES:
            of = replace(problem(CASES[name], phase), accuracy=ACCURACY)
            run = finished(runs.begin(of)())
            estimate = run.error_estimate
            assert estimate is not None
            fine = fixed(replace(of, accuracy=None), FINE)
            finer = variable(of, runs.STEP_ERROR * of.worm.length / FINER)
            unit = estimate.asked / ACCURACY
            truth = 0.5 * (fine.distance + finer.distance)
            apart = abs(fine.distance - finer.distance) / unit
            near = min((fine.distance, finer.distance), key=lambda d: abs(d - run.distance))
            error = abs(run.distance - (truth if apart <= AGREE else near)) / unit
            told, factor = estimate.distance / unit, SECONDS / run.wall_s
            turn = np.rad2deg([each.heading[-1] - each.heading[0] for each in (run, finer)])
            work = [float(each.energy.work_contract.sum()) for each in (run, finer)]
            ratios.append(told / max(error, 1e-12))
            worst, slowest = max(worst, error), min(slowest, factor)
            say(
                f"{name:17} {phase:.2f} {truth:9.5f} m{' ' if apart <= AGREE else '?'} agree {100 * apart:6.3f} %  "
                f"error {100 * error:6.3f} %  estimate {100 * told:6.3f} %  turn {turn[0] - turn[1]:+7.3f} of "
                f"{np.rad2deg(estimate.heading):6.3f} deg  work {work[0] - work[1]:+.1e} of {estimate.work:.1e} J  "
                f"{'met' if estimate.met else 'NOT'}  {estimate.steps:6d} steps {estimate.runs} runs  {factor:5.1f}",
            )
    honest = float(np.mean(np.array(ratios) >= 0.5))
    say(
        f"largest error {100 * worst:.2f} %; within twice the estimate in {100 * honest:.0f} %; median of estimate "
        f"over error {np.median(ratios):.2f}; least real-time factor {slowest:.1f}"
    )


def steps_of(run: Run) -> tuple[float, int]:
    """Finish a run, and return its distance and the number of its steps."""
    result = finished(run.finish())
    return result.distance, int(run.solves) or len(result.newton_iterations)


def wavelength() -> None:
    """Print the rms of the distance over 21 wavelengths about a parabola, 6 s each."""
    waves = np.linspace(0.9, 1.1, 21)
    cases = [problem(("flat", f"gait.wavelength={wave}"), seconds=6.0) for wave in waves]
    ways: dict[str, Callable[[Problem], Run]] = {
        f"fixed {1e3 * dt:g} ms": partial(lambda of, dt: Run(replace(of, dt=dt)), dt=dt) for dt in (0.01, 0.006, 0.003)
    }
    ways |= {f"allowed {each:g} m": partial(Run, allowed=each) for each in (2e-5, 1e-5, 1e-6, 1e-7)}
    for label, make in ways.items():
        way, steps = np.array([steps_of(make(of)) for of in cases]).T
        rest = way - np.polyval(np.polyfit(waves, way, 2), waves)
        say(f"{label:16} {steps.mean():6.0f} steps, rms {np.sqrt(np.mean(rest**2)):.2e} m")


def limit() -> None:
    """Print where runs of two gaits that turn lead as steps become short."""
    for name in ("bias 0.6", "hinges 30 deg"):
        of = problem(CASES[name])
        for label, order, dts in (("BDF2", 2, (1e-4, 5e-5)), ("implicit Euler", 1, (1e-4, 5e-5))):
            method = "bdf2" if label == "BDF2" else "implicit_euler"
            pair = [ends(fixed(of, dt, integrator=method)) for dt in dts]
            say(f"{name:17} {label:14} {told(2**order * pair[1] / (2**order - 1) - pair[0] / (2**order - 1))}")
        for allowed in (1e-8, 1e-9, 1e-10):
            say(f"{name:17} {allowed:.0e} m       {told(ends(variable(of, allowed)))}")


def ends(result: Result) -> Any:
    """Return distance and turn."""
    return np.array([result.distance, np.rad2deg(result.heading[-1] - result.heading[0])])


def told(found: Any) -> str:
    """Return distance and turn in words."""
    return f"{found[0]:.6f} m, {found[1]:.4f} degrees"


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", metavar="CASE", help="all if left out")
    parser.add_argument("--wavelength", action="store_true")
    parser.add_argument("--limit", action="store_true")
    asked = parser.parse_args()
    if asked.wavelength:
        wavelength()
    if asked.limit:
        limit()
    if not (asked.wavelength or asked.limit):
        judge(asked.cases or list(CASES))


if __name__ == "__main__":
    main()
