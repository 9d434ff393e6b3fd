"""A page that plays a run in any browser without a network. It consists of meshcat's scene and controls around it."""

from __future__ import annotations

import base64
import json
import re
import webbrowser
from dataclasses import dataclass, field
from html import escape
from importlib.resources import files
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from worm3d.viewer import camera, colours, pieces, policy, recorder
from worm3d.viewer.frames import Frames
from worm3d.viewer.piece import Piece
from worm3d.viewer.pieces import LAYERS, TRAIL_SIDES, Scales
from worm3d.viewer.skin import CORNER_WEIGHTS, LEFT_COLOUR_SHARE, RING_WEIGHTS, Skin


def write_html(
    frames: Frames,
    path: str | Path,
    *,
    skin: bool = True,
    title: str = "worm3d",
) -> None:
    """Write the run as a self-contained HTML file. The same frames always give the same bytes.

    The address of the page may set the first view, for example
    `viewer.html#t=2.5&camera=top&hide=skin,trail&show=links&world=0.3&play=1&bare=1`. The cameras are side, top, follow
    and inside. The names after `hide` and `show` are the layers in `LAYERS`. `world` is the opacity of the world, where
    0.5 is the opacity of the meshes as given. `bare` shows only the scene, without controls.

    Parameters
    ----------
    frames : Frames
        Frames to show. The motion between two frames is linear. `Frames.take` selects fewer frames.
    path : str or Path
        File to write. An existing file is replaced.
    skin : bool
        Whether a smooth skin covers the worm. The skin can be hidden on the page to show chambers and links. Without a
        skin, they are visible from the start.
    title : str
        Title on the page.
    """
    Path(path).write_text(html(frames, skin=skin, title=title), encoding="utf-8", newline="\n")


def html(frames: Frames, *, skin: bool = True, title: str = "worm3d") -> str:
    """Return the page that `write_html` writes."""
    scales = Scales.of(frames)
    parts = [
        *pieces.worm(frames, scales),
        *pieces.contact(frames, scales),
        *pieces.way(frames),
        *pieces.world(frames.world),
    ]
    cover = Skin.of(frames, scales.strain) if skin else None
    if cover is not None:
        parts.append(cover.piece())
    return filled(
        "viewer.html",
        title=escape(title),
        style=resource("viewer.css"),
        meshcat=recorder.script(),
        scene=json.dumps(_scene(frames, parts, scales, cover), separators=(",", ":"), allow_nan=False).replace(
            "<", "\\u003c"
        ),
        commands="\n".join(base64.b64encode(message).decode("ascii") for message in commands(frames, parts)),
        script=resource("viewer.js"),
    )


@dataclass(frozen=True)
class NotebookView:
    """The value of a notebook cell that displays a page. The page is stored in the notebook and needs no server."""

    page: str = field(repr=False)
    """HTML of the page."""
    height: int = 520
    """Height of the cell [pixel]."""

    def open(self) -> Path:
        """Open the page in a browser, and return the temporary file that holds it."""
        with NamedTemporaryFile("w", prefix="worm3d-", suffix=".html", encoding="utf-8", delete=False) as file:
            file.write(self.page)
        webbrowser.open(Path(file.name).as_uri(), new=2)
        return Path(file.name)

    def _repr_html_(self) -> str:
        return (
            f'<iframe srcdoc="{escape(self.page, quote=True)}" style="width: 100%; height: {self.height}px; border: 0" '
            'title="worm3d viewer"></iframe>'
        )


def commands(frames: Frames, parts: list[Piece]) -> list[bytes]:
    """Return packed commands of meshcat that set the stage, place all pieces in the first frame, and define motions."""
    placed = (command for part in parts for command in recorder.place(part))
    motion = recorder.animate(parts, frames.time - frames.time[0])
    return [recorder.packed(command) for command in (*recorder.stage(), *placed, motion)]


def filled(template: str, *inner: str, **parts: str) -> str:
    """Return a template of the folder `page` whose placeholders are replaced by `parts` and by the policy of the page.

    All parts are inserted in a single pass, so that a part may contain text that looks like a placeholder. `inner` are
    pages that this page contains in frames.
    """
    later = {"policy": "{{policy}}"}  # stays in place in this pass, because the policy depends on the filled page
    page = re.sub(r"\{\{(\w+)\}\}", lambda name: (parts | later)[name[1]], resource(template))
    return page.replace("{{policy}}", policy.of_page(page, *inner), 1)


def resource(name: str) -> str:
    """Return the text of a file of the folder `page`."""
    return files("worm3d.viewer").joinpath("page", name).read_text(encoding="utf-8")


def _scene(frames: Frames, parts: list[Piece], scales: Scales, skin: Skin | None) -> dict[str, Any]:
    """Return the data of the page, except for meshcat's commands."""
    eye, look = camera.inside(frames)
    low, high = frames.extent
    ahead = frames.heading
    azimuth, ground = camera.azimuths(frames), camera.floor(frames.world)
    return {
        "time": _floats(frames.time - frames.time[0]),
        "start": float(frames.time[0]),
        "centre": _floats(frames.centre),
        "eye": _floats(eye),
        "look": _floats(look),
        "speed": _floats(frames.speed),
        "period": frames.period,
        "reference_speed": _floats(frames.reference_speed),
        "azimuth": _floats(azimuth - np.arctan2(ahead[1], ahead[0])),
        "floor": None if ground is None else ground.tolist(),
        "centreline": frames.centreline is not None,
        "heading": ahead.tolist(),
        "size": float(np.linalg.norm(np.subtract(*frames.take([0]).extent))),
        "tall": float(np.ptp(frames.apexes[..., 2].reshape(len(frames), -1), axis=1).max()),
        "low": low.tolist(),
        "high": high.tolist(),
        "layers": _layers(parts, " on the ground" if frames.way is not frames.com else ""),
        "skin": None if skin is None else _skin(skin),
        "trail": _trail(frames, parts),
        "legend": {
            "strain": scales.strain,
            "colours": [colours.as_hex(colour) for colour in colours.RAMP],
            "force": None if frames.contact_force is None else scales.force,
            "arrow": pieces.arrow_length(frames.body_length),
        },
    }


def _skin(skin: Skin) -> dict[str, Any]:
    """Return the data of the skin for the page: the sections, and the weights of their points and colours."""
    return {
        "sections": _floats(skin.sections),
        "tint": _floats(skin.tint),
        "along": RING_WEIGHTS.tolist(),
        "around": CORNER_WEIGHTS.tolist(),
        "left": LEFT_COLOUR_SHARE.tolist(),
    }


def _layers(parts: list[Piece], where: str) -> list[dict[str, Any]]:
    """Return the switches of the layers on the page. Layers that the skin covers are off at first.

    `where` is a text that is added to the name of the trail.
    """
    first = {part.layer: part.colour for part in reversed(parts)}
    covered = ("links", "chambers") if "skin" in first else ()
    return [
        {
            "name": name,
            "label": label + where * (name == "trail"),
            "colour": colours.as_hex(first[name]),
            "visible": name not in covered,
        }
        for name, (label, _) in LAYERS.items()
        if name in first
    ]


def _trail(frames: Frames, parts: list[Piece]) -> dict[str, Any] | None:
    if frames.way is None or not any(part.layer == "trail" for part in parts):
        return None
    return {"rings": pieces.trail_rings(frames.way, frames.body_length)[1], "faces": 2 * TRAIL_SIDES}


def _floats(values: ArrayLike | None) -> str | None:
    if values is None:
        return None
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode("ascii")
