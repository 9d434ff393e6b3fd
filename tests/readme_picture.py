"""Draw the README's picture: `.venv/bin/python tests/readme_picture.py`."""

from pathlib import Path

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from planar import published

INSTANTS = np.arange(4.0, 6.01, 0.4)
OUT = Path(__file__).parents[1] / ".readme" / "worm.png"


def main() -> None:
    run = published.simulate()
    net = run.net
    figure = Figure(figsize=(6.4, 5.6), dpi=100, layout="constrained")
    for axes, t in zip(figure.subplots(len(INSTANTS), 1, sharex=True), INSTANTS, strict=True):
        step = round(t / run.dt)
        x = run.q[step]
        corners = np.stack([x[net.main[:-1]], x[net.top], x[net.main[1:]], x[net.bottom]], axis=1)
        bodies = PolyCollection(corners, cmap="bwr", clim=(-1.2, 1.2), edgecolors="0.15", lw=1.5)
        bodies.set_array(run.activation[step - 1])
        axes.add_collection(bodies)
        axes.axhspan(-0.2, net.rest[:, 1].min() - run.parameters.ground_clearance, color="0.85", lw=0)
        axes.set(xlim=(0.3, 1.9), ylim=(-0.13, 0.13), aspect="equal", yticks=[])
        axes.set_ylabel(f"{t:.1f} s", rotation=0, ha="right", va="center")
        axes.tick_params(bottom=axes is figure.axes[-1])
    figure.axes[-1].set_xlabel("x [m]")
    OUT.parent.mkdir(exist_ok=True)
    figure.savefig(OUT, metadata={"Software": None})


if __name__ == "__main__":
    main()
