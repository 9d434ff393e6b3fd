"""How fast the published MuJoCo model of a mesh worm runs: six segments of braided tubes, 2,808 degrees of freedom.

    python tests/benchmarks/mesh_worm.py MODEL.xml [--steps 20]

`MODEL.xml` is a worm of the public repository `sriddle97/3D-Soft-Worm-Robot-Model` (CC0; S. Riddle et al.,
doi 10.1088/1748-3190/ae0631), such as `Mechanical_Analysis_Model/worm_modeling/worm_test_connector_mass.xml`. Its
cables are elements that MuJoCo 4 no longer has: take an environment of its own with `pip install 'mujoco<4'`. Pipes
that the model includes by paths of another system are left out; the worm stands on the model's own floor.
"""

from __future__ import annotations

import re
from pathlib import Path
from time import process_time
from typing import Annotated

import mujoco
import typer
from calibration import calibrate

WARM_UP = 3
"""Steps that are not timed."""


def main(
    model: Annotated[Path, typer.Argument(help="The worm, as MJCF.", exists=True, dir_okay=False)],
    steps: Annotated[int, typer.Option(help="Steps that are timed.", min=1)] = 20,
) -> None:
    """Print the size of the model, the processor time of a step, and how much slower than real time it is."""
    alone = re.sub(r'<include file="[^"]*\\[^"]*"\s*/>', "", model.read_text(encoding="utf-8"))
    try:
        worm = mujoco.MjModel.from_xml_string(alone)
    except ValueError as error:
        typer.echo(f"{model.name}: MuJoCo {mujoco.__version__} cannot read it ({error}); take mujoco<4", err=True)
        raise typer.Exit(4) from error
    data = mujoco.MjData(worm)
    mujoco.mj_step(worm, data, nstep=WARM_UP)
    began = process_time()
    mujoco.mj_step(worm, data, nstep=steps)
    dt, step = worm.opt.timestep, (process_time() - began) / steps
    typer.echo(
        f"MuJoCo {mujoco.__version__}, {model.name}: {worm.nv} degrees of freedom, {data.nefc} constraints, steps of "
        f"{1e3 * dt:g} ms; {1e3 * step:.1f} ms of CPU a step, {step / dt:.0f} times slower than real time; "
        f"calibration loop {calibrate():.2f} us"
    )


if __name__ == "__main__":
    typer.run(main)
