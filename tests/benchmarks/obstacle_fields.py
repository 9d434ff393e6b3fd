"""Random fields of obstacles: whether the whole body stays clear of them, and whether those without a way are refused.

    python tests/benchmarks/obstacle_fields.py [--seed 300] [--count 20] [--controller mpc] [--workers 2]

Each draw is a line with an end, an S-curve or a circle, with 2 to 5 discs and walls beside it, each of which may be
unknown until it is near. A draw is solvable if a search that shares nothing with the planner finds a way: arcs of the
curvatures 0, 0.75 and 1.5 per body length, on which a body with 0.02 BL of room keeps off all obstacles, unknown ones
too. Draws go on until `count` of them are solvable; the others must be refused or end in a stop. Printed are, for each
run, the clearance of the body and the offset from the bare path [body lengths], the way made along it, and the faults.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np

from control.tracking.obstacles import Disc, Obstacle, Wall, nearest
from control.tracking.paths import track
from control.tracking.references import Reference
from scenes.language.errors import SceneError
from scenes.models.control.reference import reference_of
from scenes.models.loading import load_scene
from scenes.running.runner import simulate

DURATION = 55.0
"""Time of a run [s], in which a worm at 0.08 m/s goes 4.4 m."""
PATHS: dict[str, tuple[str, ...]] = {
    "path_line": ("reference.length_m=4.0", "reference.ends=true"),
    "path_s_curve": ("reference.amplitude_m=0.3",),
    "path_circle": ("reference.radius_m=1.5",),
}
LENGTH, HALF_WIDTH, ROOM = 1.0, 0.116, 0.02
"""The default worm, and how far it is to keep off in the search for a way [m]."""
ARC, CURVATURES, CELL, TURN, AWAY = 0.2, (-1.5, -0.75, 0.0, 0.75, 1.5), 0.05, np.deg2rad(7.5), 1.0
WAY = 3.9
"""Way along the path after which a search has passed the field [m]."""


class Field(NamedTuple):
    """A draw."""

    seed: int
    scene: str
    overrides: list[str]
    bare: Reference
    """Reference without the obstacles."""
    obstacles: tuple[Obstacle, ...]


def field(seed: int) -> Field:
    """Return a draw."""
    random = np.random.default_rng([300, seed])
    name = str(random.choice(list(PATHS)))
    common = [f"seed={seed}", "controller.map=default", f"run.duration_s={DURATION}", "run.record_every=4"]
    corridor = "reference.corridor_m=" + (f"{random.uniform(0.4, 1.0):.3f}" if random.uniform() < 0.5 else "5.0")
    base = [*PATHS[name], corridor, *common]
    bare = reference_of(load_scene(name, base).settings)
    assert bare.path is not None
    tables, obstacles = [], list[Obstacle]()
    for s in random.uniform(1.0, 3.4, random.integers(2, 6)):
        aside, heading = random.normal(0.0, 0.3), float(bare.path.heading(s))
        x, y = np.round(bare.path.point(s) + aside * np.array([-np.sin(heading), np.cos(heading)]), 4).tolist()
        sight = round(random.uniform(0.5, 1.2), 3) if random.uniform() < 0.3 else np.inf
        table = f"x_m={x}, y_m={y}" + (f", sight_m={sight}" if np.isfinite(sight) else "")
        if random.uniform() < 0.3:
            length, radius, azimuth = np.round(random.uniform([0.2, 0.02, -90.0], [0.8, 0.06, 90.0]), 3).tolist()
            table += f', kind="wall", length_m={length}, radius_m={radius}, azimuth_deg={azimuth}'
            obstacles.append(Wall(x, y, radius, length, np.deg2rad(azimuth), sight))
        else:
            radius = round(random.uniform(0.05, 0.25), 3)
            table += f", radius_m={radius}"
            obstacles.append(Disc(x, y, radius, sight))
        tables.append(f"{{{table}}}")
    return Field(seed, name, [*base, f"reference.obstacles=[{', '.join(tables)}]"], bare, tuple(obstacles))


def solvable(drawn: Field) -> bool:
    """Return whether arcs lead a body past all obstacles of a draw, layer by layer from where it begins."""
    reference, path = drawn.bare, drawn.bare.path
    assert path is not None
    spots, near = LENGTH * np.linspace(-0.5, 0.5, 11), np.linspace(-0.6, WAY + 0.6, 181)
    line, turned = path.point(near), path.heading(near)
    states, seen = np.array([[*path.point(0.0), float(path.heading(0.0))]]), set[tuple[int, ...]]()
    while len(states):
        x, y, h = (np.repeat(each, len(CURVATURES)) for each in states.T)
        turn = ARC / 2.0 * np.tile(CURVATURES, len(states))
        for _ in range(2):  # halves of an arc
            x, y = x + ARC / 2.0 * np.cos(h + turn / 2.0), y + ARC / 2.0 * np.sin(h + turn / 2.0)
            h = h + turn
            body = (
                np.stack([x, y], axis=-1)[:, None] + spots[:, None] * np.stack([np.cos(h), np.sin(h)], axis=-1)[:, None]
            )
            off = np.linalg.norm(body[:, 5, None] - line, axis=-1)
            s, off = off.argmin(axis=1), off.min(axis=1)
            keeps = nearest(drawn.obstacles, body).min(axis=1) > HALF_WIDTH + ROOM
            keeps &= (off < reference.corridor) & (np.abs(np.angle(np.exp(1j * (h - turned[s])))) < AWAY)
            x, y, h, s, turn, off = (each[keeps] for each in (x, y, h, s, turn, off))
        if ((near[s] > WAY - ARC) & ((off < 0.1) | (not reference.ends))).any():
            return True
        cells = np.stack([np.floor(x / CELL), np.floor(y / CELL), np.round(h / TURN)], axis=-1).astype(int)
        first = {cell: k for k, cell in enumerate(map(tuple, cells.tolist())) if cell not in seen}
        seen |= set(first)
        states = np.stack([x, y, h], axis=-1)[list(first.values())].reshape(-1, 3)
    return False


def measured(task: tuple[Field, str]) -> dict[str, Any]:
    """Return the figures of one run."""
    drawn, controller = task
    try:
        scene = load_scene(drawn.scene, [*drawn.overrides, f"controller.kind={controller}"])
    except SceneError as error:
        return {"refused": str(error).splitlines()[-1]}
    run = simulate(scene)
    assert drawn.bare.path is not None
    return {
        "clearance": run.summary["body_clearance_min_bl"],
        "offset": run.summary["cross_track_max_bl"],
        "way": track(drawn.bare.path, run["com"][::25, :2])[-1],
        "faults": [str(row["kind"]) for row in run.summary.faults],
    }


def lines(seed: int, wanted: int, controller: str, workers: int) -> Iterator[str]:
    """Yield a line for each draw, and one that sums them up."""
    fields, hard = list[Field](), set[int]()
    while len(fields) - len(hard) < wanted:
        fields.append(field(seed + len(fields)))
        hard |= set() if solvable(fields[-1]) else {fields[-1].seed}
    yield f"{len(fields)} draws, {len(hard)} of them without a way by the search"
    entered = refused = stopped = kept = 0
    with get_context("spawn").Pool(workers) as pool:
        for drawn, each in zip(fields, pool.imap(measured, [(one, controller) for one in fields]), strict=True):
            what = f"{drawn.seed:4d} {drawn.scene:12s} {'no way' if drawn.seed in hard else 'solvable':8s}"
            if "refused" in each:
                refused += drawn.seed in hard
                kept += drawn.seed not in hard
                yield f"{what} refused: {each['refused']}"
                continue
            entered += each["clearance"] < 0.0
            stopped += "blocked" in each["faults"]
            figures = f"clearance {each['clearance']:7.4f}  offset {each['offset'] or 0.0:.3f}  way {each['way']:.2f} m"
            yield f"{what} {figures}  {', '.join(each['faults'])}"
    ends = f"stopped before an obstacle that came into sight: {stopped}"
    yield f"clearance below 0: {entered}; refused: {refused} without a way, {kept} with one; {ends}"


def main() -> None:
    """Print the lines."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seed", type=int, default=300)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--controller", default="mpc")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    for line in lines(given.seed, given.count, given.controller, given.workers):
        sys.stdout.write(line + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
