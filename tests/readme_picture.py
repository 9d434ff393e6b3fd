"""Draw the picture of the guide on scenes: `.venv/bin/python tests/readme_picture.py`."""

from pathlib import Path

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from control import gaits
from planar import linkage
from planar.animation import CONTRACTED_RED

INSTANTS = np.arange(4.0, 6.01, 0.4)
OUT = Path(__file__).parents[1] / ".docs" / "_static" / "worm.png"


def main() -> None:
    worm = linkage.Linkage(mass=0.1, half_height=0.05, k_torsion=10.0, k_apex=0.0)
    wave = gaits.TravellingWave()
    run = linkage.simulate(worm, lambda t: wave.amplitude * wave.activation(t, 6), duration=6.0)
    figure = Figure(figsize=(7.2, 5.2), dpi=100, layout="constrained")
    for axes, t in zip(figure.subplots(len(INSTANTS), 1, sharex=True), INSTANTS, strict=True):
        step = round(t / run.dt)
        joints, apexes = run.joints[step], run.apexes[step]
        corners = np.stack([joints[:-1], apexes[:, 1], joints[1:], apexes[:, 0]], axis=1)
        bodies = PolyCollection(corners, cmap=CONTRACTED_RED, clim=(-0.25, 0.25), edgecolors="0.15", lw=1.5)
        bodies.set_array(run.contraction[step])
        axes.add_collection(bodies)
        axes.axhspan(-0.05, 0.0, color="0.85", lw=0)
        loaded = run.normal_load[step, :, 0] > 0.0
        stuck = loaded & (run.slip[step - 1, :, 0] == 0.0)
        axes.plot(apexes[stuck, 0, 0], np.full(stuck.sum(), -0.012), "^", color="C2", ms=7, label="anchored")
        slides = loaded & ~stuck
        axes.plot(apexes[slides, 0, 0], np.full(slides.sum(), -0.012), "o", color="C1", ms=5, label="slides")
        axes.set(xlim=(0.1, 1.4), ylim=(-0.04, 0.15), aspect="equal", yticks=[])
        axes.set_ylabel(f"{t:.1f} s", rotation=0, ha="right", va="center")
        axes.tick_params(bottom=axes is figure.axes[-1])
    figure.axes[-1].set_xlabel("x [m]")
    handles = [figure.axes[0].lines[k] for k in range(2)]
    figure.legend(handles=handles, loc="outside upper right", fontsize=8, ncols=2, frameon=False)
    OUT.parent.mkdir(exist_ok=True)
    figure.savefig(OUT, metadata={"Software": None})


if __name__ == "__main__":
    main()
