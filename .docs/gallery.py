"""Write the gallery, with a picture, a film and the file of each shipped scene: `python .docs/gallery.py OUT`."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from html import escape
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image
from scipy.spatial import KDTree

from scenes.language.loader import shipped_scenes
from scenes.models.loading import Scene, load_scene
from scenes.records.record import Record
from scenes.running.runner import simulate

if TYPE_CHECKING:
    from worm3d.viewer import Frames, WorldMesh

SCENE_GROUPS = {
    "On the ground": "flat slope slope_5 slope_15 rubble free_fall",
    "In pipes and tunnels": "pipe_straight pipe_bend pipe_narrowing pipe_vertical pipe_reflex pipe_reflex_vertical "
    "slope_into_pipe mesh_tunnel",
    "Gaits and turning": "inchworm phases optimised_speed optimised_robust shc larva_network turn turn_planned "
    "sidewinding circling",
    "With a controller": "path_line path_circle path_s_curve path_s_curve_slope path_waypoints there_and_back "
    "obstacles disturbance_push heading_hold stop_and_go velocity_step velocity_sine velocity_pipe "
    "pipe_climb_controlled",
    "The planar worm and measurements": "planar_published planar_wave planar_case planar_segments planar_periods "
    "load_frame",
}
"""Names of scenes by heading. Other shipped scenes follow under the heading `OTHERS`."""
OTHERS = "Other scenes"

SECONDS = {
    **dict.fromkeys(("path_line", "path_s_curve", "path_s_curve_slope", "velocity_pipe"), 20),
    **dict.fromkeys(("velocity_sine", "heading_hold", "disturbance_push"), 32),
    **dict.fromkeys(("path_waypoints", "obstacles", "velocity_step"), 45),
    **dict.fromkeys(("pipe_climb_controlled", "path_circle", "stop_and_go", "there_and_back"), 60),
}
"""Durations of long runs in the gallery [s]."""
SHOWN_CASES = {"planar_segments": "worm.segments=4", "planar_periods": "gait.period_s=1"}
"""The case that the gallery shows of a scene with a sweep."""
BEGINS = {
    "disturbance_push": 19.0,
    "heading_hold": 9.0,
    "obstacles": 16.0,
    "stop_and_go": 30.0,
    "velocity_step": 17.0,
    "velocity_sine": 10.0,
    "there_and_back": 17.0,
    "path_waypoints": 25.0,
    "path_circle": 40.0,
    "pipe_climb_controlled": 30.0,
}
"""First instants of films that do not show the whole run [s]."""
PICTURED = {"disturbance_push": 24.0, "free_fall": 0.16, "obstacles": 24.0, "pipe_climb_controlled": 45.0}
"""Instants of pictures that do not show the end of a run [s]."""

FRAMES, FPS = 150, 25.0
"""Largest number of frames of a playable page, and of frames per second."""
PER_PERIOD = 6
"""Smallest number of frames per period of a gait. A film with fewer frames would not show the wave."""
MOST_FACES, REACH = 12_000, 0.6
"""Number of faces above which the surroundings end at a distance from the worm, and this distance [body lengths]."""
FILM_DPI = 65
"""Resolution of animations [pixels per inch]."""
LARGEST_PAGE, LARGEST_FILM, LARGEST_PICTURE = 600_000, 300_000, 60_000
"""Largest sizes of files [byte]."""
PLAYER = "_player.js"
"""File with the script of all playable pages."""

STYLE = """<style>
.scenes { display: grid; grid-template-columns: repeat(auto-fill, minmax(15rem, 1fr)); gap: 1rem; }
.scenes a { border: 1px solid #8886; border-radius: 6px; overflow: hidden; text-decoration: none; }
.scenes img { display: block; width: 100%; height: 9rem; object-fit: contain; background: #fff; }
.scenes b, .scenes small { display: block; padding: 0.3rem 0.6rem 0; }
.scenes small { padding-bottom: 0.5rem; color: inherit; opacity: 0.8; }
</style>"""

GALLERY_INDEX = """# Gallery

Each picture leads to the page of a shipped scene. The page has a film that plays in the browser without a network,
and the file of the scene. `worm3d run NAME` runs a scene with its full duration.

{style}
{groups}

```{{toctree}}
:hidden:

{names}
```
"""

PAGE = """# {title}

{says}

{film}

{shown} Run the scene:

```text
worm3d run {name} --out {name}
```

The file of the scene:

```{{literalinclude}} ../../scenes/{name}.toml
:language: toml
```
"""


def main(folder: Path) -> None:
    """Write the gallery into `folder`/gallery. The scenes run in two processes."""
    gallery = folder.resolve() / "gallery"
    (gallery / "play").mkdir(parents=True, exist_ok=True)
    names = sorted(shipped_scenes(), key=_work, reverse=True)
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        for done in [pool.submit(make, name, gallery) for name in names]:
            done.result()
    (gallery / "index.md").write_text(index(), encoding="utf-8")


def _work(name: str) -> tuple[bool, float]:
    """Return a key that is larger for scenes that take longer."""
    scene = shown(name)
    return scene.model.name == "worm_control", float(scene.settings.run.duration_s)


def shown(name: str) -> Scene:
    """Return a scene as the gallery runs it."""
    changes = [f"run.duration_s={SECONDS[name]}"] if name in SECONDS else []
    return load_scene(name, [*changes, SHOWN_CASES[name]] if name in SHOWN_CASES else changes)


def make(name: str, gallery: Path) -> None:
    """Run a scene, and write the page, the picture and the film."""
    scene = shown(name)
    record = simulate(scene)
    if record.status != "done":
        raise RuntimeError(f"{name}: {record.sentence}")
    film, part = write_film(scene, record, gallery)
    write_picture(scene, record, gallery / f"{name}.png")
    (gallery / f"{name}.md").write_text(page(scene, film, part), encoding="utf-8")


def write_film(scene: Scene, record: Record, gallery: Path) -> tuple[str, str]:
    """Write a playable page or an animation. Return the path in the gallery, and a sentence on the part of the run.

    Both are empty for a model without films.
    """
    if scene.model.view is not None:
        film = f"play/{scene.name}.html"
        return film, write_playable(scene, record, gallery / film)
    if scene.model.animate is not None:
        write_animation(scene, record, gallery / f"{scene.name}.gif")
        return f"{scene.name}.gif", ""
    return "", ""


def write_playable(scene: Scene, record: Record, path: Path) -> str:
    """Write a page that plays a run, without links, and return a sentence on the part that the page shows.

    A page that would be too large shows a shorter part.
    """
    from worm3d.viewer import write_html

    for most in (FRAMES, 130, 100, 75):
        frames = frames_shown(record, BEGINS.get(scene.name, 0.0), most)
        write_html(frames, path, title=record.title, script=path.parent / PLAYER, without=("links",))
        if path.stat().st_size <= LARGEST_PAGE:
            return f"The film shows the time from {frames.time[0]:.3g} s to {frames.time[-1]:.3g} s."
    raise RuntimeError(f"{path.name}: {path.stat().st_size} bytes, must be at most {LARGEST_PAGE}")


def frames_shown(record: Record, begin: float, most: int) -> Frames:
    """Return at most `most` frames of a run, from an instant on [s], so many per period that the wave is seen."""
    from scenes.models.worm.view import frames_of

    period = frames_of(record, fps=1.0).period
    begin = begin if period else 0.0
    least = PER_PERIOD / period if period else 0.0
    fps = min(FPS, max((most - 1) / (float(record["time"][-1]) - begin), least))
    frames = frames_of(record, fps=fps)
    return near(frames.take(np.flatnonzero(frames.time >= begin - 1e-9)[:most].tolist()))


def near(frames: Frames) -> Frames:
    """Return frames whose surroundings, if they have many faces, end at the distance `REACH` from the worm."""
    if sum(len(mesh.faces) for mesh in frames.world) <= MOST_FACES:
        return frames
    joints = KDTree(frames.joints.reshape(-1, 3))
    return replace(frames, world=tuple(_cut(mesh, joints, REACH * frames.body_length) for mesh in frames.world))


def _cut(mesh: WorldMesh, joints: KDTree, reach: float) -> WorldMesh:
    """Return the faces of a mesh that are near a joint, with their vertices only."""
    kept = mesh.faces[joints.query(mesh.vertices[mesh.faces].mean(axis=1))[0] < reach]
    if not len(kept):
        return mesh
    used, faces = np.unique(kept, return_inverse=True)
    return replace(mesh, vertices=mesh.vertices[used], faces=faces.reshape(-1, 3))


def write_animation(scene: Scene, record: Record, path: Path) -> None:
    """Write a GIF in real time. If the file would be too large, it has fewer frames per second."""
    assert scene.model.animate is not None
    movie: Any = scene.model.animate(record)  # `planar.animation.Movie`, which can draw single frames
    movie.figure.set_dpi(FILM_DPI)
    instants = np.arange(0.0, movie.time[-1], 0.1)
    drawn = [_pixels(movie.draw(int(np.abs(movie.time - instant).argmin()))) for instant in instants]
    sample = np.concatenate([np.asarray(drawn[k]) for k in (0, len(drawn) // 3, len(drawn) // 2, -1)])
    palette = Image.fromarray(sample).quantize(32, method=Image.Quantize.MAXCOVERAGE)
    frames = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in drawn]
    for every in (1, 2, 3):
        first, *rest = frames[::every]
        first.save(path, save_all=True, append_images=rest, duration=100 * every, loop=0)
        if path.stat().st_size <= LARGEST_FILM:
            return
    raise RuntimeError(f"{path.name}: {path.stat().st_size} bytes, must be at most {LARGEST_FILM}")


def _pixels(figure: Any) -> Image.Image:
    """Return a figure as an image."""
    figure.canvas.draw()
    return Image.fromarray(np.asarray(figure.canvas.buffer_rgba())[..., :3].copy())


def write_picture(scene: Scene, record: Record, path: Path) -> None:
    """Write a picture of a run, with so few colours that the file is small enough."""
    if scene.model.view is not None:
        _draw_worm(record, path, PICTURED.get(scene.name))
    elif scene.model.overview is not None:
        scene.model.overview(record).save(path)
    with Image.open(path) as image:
        drawn = image.convert("RGB")
    for colours in (128, 64, 32, 16):
        drawn.quantize(colours, dither=Image.Dither.NONE).save(path, optimize=True)
        if path.stat().st_size <= LARGEST_PICTURE:
            return
    raise RuntimeError(f"{path.name}: {path.stat().st_size} bytes, must be at most {LARGEST_PICTURE}")


def _draw_worm(record: Record, path: Path, at: float | None) -> None:
    """Draw the worm from the side and from above, at an instant [s] or at the end of the run."""
    from scenes.models.worm.view import frames_of
    from worm3d.results.pictures import nearest
    from worm3d.viewer.figure import figure

    frames = frames_of(record, at=at)
    figure(frames, nearest(frames.time, at))[0].savefig(path)


def page(scene: Scene, film: str, part: str) -> str:
    """Return the page of a scene as MyST."""
    name, title = scene.name, escape(scene.settings.title)
    seen = f'<img src="{name}.png" alt="{title}" style="background: #fff">'
    if film.endswith(".html"):
        seen = f'<p><a href="{film}">{seen}</a></p>\n<p><a href="{film}"><b>Play the run in 3D</b></a></p>'
    elif film:
        seen = f'<img src="{film}" alt="{title}" style="background: #fff">\n{seen}'
    return PAGE.format(
        title=scene.settings.title, says=sentences(scene), film=seen, shown=extent(scene, part), name=name
    )


def sentences(scene: Scene) -> str:
    """Return what a scene says to see, as MyST. Options of the command are set as code."""
    return re.sub(r"-o \S+\w", r"`\g<0>`", scene.settings.says)


def extent(scene: Scene, part: str) -> str:
    """Return sentences on the part of the scene that the page shows. `part` is the sentence of `write_film`."""
    seconds, whole = scene.settings.run.duration_s, load_scene(scene.name).settings.run.duration_s
    run = f"The run was ended after {seconds:g} s of {whole:g} s." if seconds < whole else f"The run takes {whole:g} s."
    case = f"The case of the sweep is `{SHOWN_CASES[scene.name]}`." if scene.name in SHOWN_CASES else ""
    return " ".join(filter(None, [run, case, part]))


def index() -> str:
    """Return the page with the pictures of all scenes as MyST."""
    groups = "\n\n".join(f"## {heading}\n\n{grid(names)}" for heading, names in grouped())
    return GALLERY_INDEX.format(style=STYLE, groups=groups, names="\n".join(n for _, names in grouped() for n in names))


def grouped() -> Iterator[tuple[str, list[str]]]:
    """Yield each heading with the names of the scenes under the heading."""
    known = shipped_scenes()
    listed = {heading: [name for name in names.split() if name in known] for heading, names in SCENE_GROUPS.items()}
    others = [name for name in known if not any(name in names for names in listed.values())]
    yield from listed.items()
    if others:
        yield OTHERS, others


def grid(names: Iterable[str]) -> str:
    """Return the pictures of scenes, each a link to the page of the scene, as HTML."""
    return '<div class="scenes">\n' + "\n".join(_card(load_scene(name)) for name in names) + "\n</div>"


def _card(scene: Scene) -> str:
    name, title, says = scene.name, escape(scene.settings.title), escape(scene.settings.says.split(". ")[0].rstrip("."))
    return f'<a href="{name}.html"><img src="{name}.png" alt="{title}"><b>{title}</b><small>{says}.</small></a>'


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python .docs/gallery.py OUT")
    main(Path(sys.argv[1]))
