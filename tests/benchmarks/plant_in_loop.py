"""Planning on the plant itself against the controller `mpc`: a line, a circle, a corner and a bend in a pipe.

    python tests/benchmarks/plant_in_loop.py [CASE ...] [--period 0.4] [--duration 30]

Both drive the default worm. `plant` plans on a copy of the worm with exact sensitivities, and knows the true state
(`scenes/models/control/plant_in_loop.py`). `mpc` plans on the reduced model and estimates the state from the default
sensors; `mpc, exact sensors` gets strains and the centre of mass without noise. Each line has the rms offset from the
path [body lengths], the rms and the mean error of the speed [%], and the processor time of a control step, all steps of
a decision together: median, and 99 of 100 [ms]. A decision fits if it takes less than the period.
"""

from __future__ import annotations

from time import thread_time
from unittest import mock

from measuring import options, say

from scenes.models.loading import load_scene
from scenes.running.runner import simulate
from scenes.studies.bench.control import timing

BENT = '[{straight_m=0.6},{bend_deg=60.0,bend_radius_m=1.0,towards="left"},{straight_m=3.0}]'
CASES = {
    "line": ("path_line",),
    "circle": ("path_circle", "reference.radius_m=0.3", "reference.speed_m_s=0.05"),
    "corner": (
        "path_waypoints",
        "reference.radius_m=0.3",
        "reference.speed_m_s=0.05",
        "reference.points=[{x_m=0.0,y_m=0.0},{x_m=1.2,y_m=0.0},{x_m=1.2,y_m=2.0}]",
    ),
    "pipe": ("velocity_pipe", f"world.pieces={BENT}"),
}
"""Scene and its overrides by the name of the case."""
EXACT = ("sensor.strain_noise=0", "sensor.com_noise_m=0")
PLANT = "scenes.models.control.plant_in_loop:PlantInLoop"
WAYS = {
    "plant": (f"controller.kind={PLANT}", "controller.mechanism=both"),
    "mpc": ("controller.kind=mpc",),
    "mpc, exact sensors": ("controller.kind=mpc", *EXACT),
}


def line(case: str, way: str, period: float, duration: float) -> str:
    """Return the line of a run."""
    scene, *overrides = CASES[case]
    own = f"controller.period_s={period}" if way == "plant" else "controller.period_s=0.2"
    overrides += [*WAYS[way], own, f"run.duration_s={duration}"]
    with (
        mock.patch("scenes.models.control.model.perf_counter", thread_time),
        mock.patch("control.loop.perf_counter", thread_time),
    ):
        run = simulate(load_scene(scene, overrides))
    found, times = run.summary.metrics, timing(run)
    figures = [found["cross_track_rms_bl"], *(found[f"speed_{of}_relative"] for of in ("error_rms", "bias"))]
    offset, rms, bias = (float("nan") if each is None else float(each) for each in figures)
    steps = " ".join(f"{times[f'control_step_ms_{p}']:6.1f}" for p in ("p50", "p99"))
    return (
        f"{case:8}{way:20}{offset:8.4f} BL {100 * rms:6.1f} {100 * bias:+6.1f} %  {steps} ms  {found['mpc_failures']}"
    )


def main() -> None:
    """Print a line for each case and each way of control."""
    given = options(__doc__ or "", CASES, period=0.4, duration=30.0)
    for case in given.names:
        for way in WAYS:
            say(line(case, way, given.period, given.duration))


if __name__ == "__main__":
    main()
