"""One page that plays the run in any browser, without a network: meshcat's scene and a page around it."""

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

from worm3d.viewer import camera, colours, pieces, policy
from worm3d.viewer.frames import Frames
from worm3d.viewer.piece import Piece
from worm3d.viewer.pieces import LAYERS, TRAIL_SIDES, Scales
from worm3d.viewer.skin import ALONG, AROUND, LEFT, Skin


def write_html(
    frames: Frames,
    path: str | Path,
    *,
    skin: bool = True,
    title: str = "worm3d",
) -> None:
    """Write the run as one HTML file that needs nothing else; the same frames give the same bytes.

    An address may say what is seen first:
    `viewer.html#t=2.5&camera=top&hide=skin,trail&show=links&world=0.3&play=1&bare=1`; cameras are side, top, follow
    and inside, layers those of `LAYERS`, `world` is its opacity (0.5 as given), `bare` leaves the scene alone.

    Parameters
    ----------
    frames : Frames
        Between them things move on straight lines; `Frames.at_rate` takes fewer.
    path : str or Path
        Replaced if it exists.
    skin : bool
        Whether a smooth skin covers the worm, which can be taken off to see chambers and links; or they are seen from
        the start, and there is no skin.
    title : str
        Shown on the page.
    """
    Path(path).write_text(html(frames, skin=skin, title=title), encoding="utf-8", newline="\n")


def html(frames: Frames, *, skin: bool = True, title: str = "worm3d") -> str:
    """Return what `write_html` writes."""
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
        meshcat=_meshcat_script(),
        scene=json.dumps(_scene(frames, parts, scales, cover), separators=(",", ":"), allow_nan=False).replace(
            "<", "\\u003c"
        ),
        commands="\n".join(base64.b64encode(message).decode("ascii") for message in commands(frames, parts)),
        script=resource("viewer.js"),
    )


@dataclass(frozen=True)
class NotebookView:
    """Shows itself where it is the value of a notebook cell; the page lives in the notebook and needs no server."""

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


def show(frames: Frames, *, height: int = 520, skin: bool = True) -> NotebookView:
    """Return the run for the end of a notebook cell; `skin` as in `write_html`.

    Parameters
    ----------
    height : int
        Height of the cell [pixel].
    """
    return NotebookView(html(frames, skin=skin), height)


def commands(frames: Frames, parts: list[Piece]) -> list[bytes]:
    """Return meshcat's packed commands: the stage, every piece in its first pose, and then how all of them move."""
    from worm3d.viewer import recorder

    window = recorder.Recorder()
    recorder.stage(window)
    for part in parts:
        recorder.place(window, part)
    recorder.animate(window, parts, frames.time - frames.time[0])
    return window.messages


def filled(template: str, *inner: str, **parts: str) -> str:
    """Return a template of the folder `page` with its parts in it, and the policy of the page.

    It is filled in one pass, so that a part may contain what looks like the name of another. `inner` are pages that
    stand in frames of this one.
    """
    later = {"policy": "{{policy}}"}  # the first of what the page contains
    page = re.sub(r"\{\{(\w+)\}\}", lambda name: (parts | later)[name[1]], resource(template))
    return page.replace("{{policy}}", policy.of_page(page, *inner), 1)


def resource(name: str) -> str:
    """Return a file of the folder `page`."""
    return files("worm3d.viewer").joinpath("page", name).read_text(encoding="utf-8")


def _meshcat_script() -> str:
    from worm3d.viewer import recorder

    return recorder.script()


def _scene(frames: Frames, parts: list[Piece], scales: Scales, skin: Skin | None) -> dict[str, Any]:
    """Return what the page knows besides meshcat's commands."""
    eye, look = camera.inside(frames)
    low, high = frames.extent
    ahead = frames.heading
    speed, azimuth, ground = frames.speed, camera.azimuths(frames), camera.floor(frames.world)
    return {
        "time": _floats(frames.time - frames.time[0]),
        "start": float(frames.time[0]),
        "centre": _floats(frames.centre),
        "eye": _floats(eye),
        "look": _floats(look),
        "speed": None if speed is None else _floats(speed),
        "period": frames.period,
        "reference_speed": None if frames.reference_speed is None else _floats(frames.reference_speed),
        "azimuth": _floats(azimuth - np.arctan2(ahead[1], ahead[0])),
        "floor": None if ground is None else ground.tolist(),
        "centreline": frames.centreline is not None,
        "heading": ahead.tolist(),
        "size": _size(frames),
        "tall": float(np.ptp(frames.apexes[..., 2].reshape(len(frames), -1), axis=1).max()),
        "low": low.tolist(),
        "high": high.tolist(),
        "layers": _layers(parts, " on the ground" if frames.way is not frames.com else ""),
        "skin": None if skin is None else _skin(skin),
        "trail": _trail(frames, parts),
        "legend": _legend(frames, scales),
    }


def _size(frames: Frames) -> float:
    """Return how large the worm is in the first frame, corner to corner [m]."""
    low, high = frames.take([0]).extent
    return float(np.linalg.norm(high - low))


def _skin(skin: Skin) -> dict[str, Any]:
    """Return what the page makes the skin of: the sections, and the weights of their points and colours."""
    return {
        "sections": _floats(skin.sections),
        "tint": _floats(skin.tint),
        "along": ALONG.tolist(),
        "around": AROUND.tolist(),
        "left": LEFT.tolist(),
    }


def _layers(parts: list[Piece], where: str) -> list[dict[str, Any]]:
    """Return the switches; what the skin covers is switched off. `where` says where the trail is drawn."""
    first = {part.layer: part.colour for part in reversed(parts)}
    covered = ("links", "chambers") if "skin" in first else ()
    return [
        {
            "name": name,
            "label": label + where * (name == "trail"),
            "colour": colours.as_hex(colour or first[name]),
            "visible": name not in covered,
        }
        for name, (label, colour) in LAYERS.items()
        if name in first
    ]


def _trail(frames: Frames, parts: list[Piece]) -> dict[str, Any] | None:
    if frames.way is None or not any(part.layer == "trail" for part in parts):
        return None
    return {"rings": pieces.trail_rings(frames.way, frames.body_length)[1], "faces": 2 * TRAIL_SIDES}


def _legend(frames: Frames, scales: Scales) -> dict[str, Any]:
    return {
        "strain": scales.strain,
        "colours": [colours.as_hex(colour) for colour in (colours.SHORTER, colours.REST, colours.LONGER)],
        "force": None if frames.contact_force is None else scales.force,
        "arrow": pieces.arrow_length(frames.body_length),
    }


def _floats(values: ArrayLike) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode("ascii")
