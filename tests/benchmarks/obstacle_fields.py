"""Random fields of obstacles, and a search for a way through them: the family `obstacles` of `closed_loop.py`.

Each draw is a line with an end, an S-curve or a circle, with 2 to 5 discs and walls beside it, each of which may be
unknown until it is near. A draw is solvable if a search that shares nothing with the planner finds a way: arcs of the
curvatures 0, 0.75 and 1.5 per body length, on which a body with 0.02 BL of room keeps off all obstacles, unknown ones
too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from control.tracking.obstacles import Disc, Obstacle, Wall, nearest
from control.tracking.references import Reference
from scenes.models.control.reference import reference_of
from scenes.models.loading import load_scene

PATHS: dict[str, tuple[str, ...]] = {
    "path_line": ("reference.length_m=4.0", "reference.ends=true"),
    "path_s_curve": ("reference.amplitude_m=0.3",),
    "path_circle": ("reference.radius_m=1.5",),
}
WAY = 3.9
"""Way along the path after which a search has passed the field [m]; the worm, of 1 m, makes 4.4 m in a run."""
ARC, CURVATURES = 0.2, (-1.5, -0.75, 0.0, 0.75, 1.5)
"""Length of the arcs of the search [m], and their curvatures [1/m]."""


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
    common = [f"seed={seed}", "controller.map=default", "run.duration_s=55.0", "run.record_every=4"]
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
    spots, near = np.linspace(-0.5, 0.5, 11), np.linspace(-0.6, WAY + 0.6, 181)
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
            keeps = nearest(drawn.obstacles, body).min(axis=1) > 0.116 + 0.02  # half width of the worm, and room
            keeps &= (off < reference.corridor) & (np.abs(np.angle(np.exp(1j * (h - turned[s])))) < 1.0)
            x, y, h, s, turn, off = (each[keeps] for each in (x, y, h, s, turn, off))
        if ((near[s] > WAY - ARC) & ((off < 0.1) | (not reference.ends))).any():
            return True
        cells = np.stack([np.floor(x / 0.05), np.floor(y / 0.05), np.round(h / np.deg2rad(7.5))], axis=-1).astype(int)
        first = {cell: k for k, cell in enumerate(map(tuple, cells.tolist())) if cell not in seen}
        seen |= set(first)
        states = np.stack([x, y, h], axis=-1)[list(first.values())].reshape(-1, 3)
    return False
