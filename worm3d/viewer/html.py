"""A page that plays a run in any browser without a network: meshcat's scene with controls around the scene."""

from __future__ import annotations

import base64
import json
import os
import re
import webbrowser
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from html import escape
from importlib.resources import files
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import ArrayLike, NDArray

from worm3d.values.arrays import FloatArray
from worm3d.viewer import camera, colours, pieces, policy, recorder
from worm3d.viewer.frames import Frames
from worm3d.viewer.packed import packed
from worm3d.viewer.piece import Piece
from worm3d.viewer.pieces import LAYERS, TRAIL_SIDES, Scales
from worm3d.viewer.recorder import ALL_BITS, shortened
from worm3d.viewer.skin import CORNER_WEIGHTS, LEFT_COLOUR_SHARE, RING_WEIGHTS, Skin

SMALL_BITS = 13
"""Number of bits after the first of the numbers in a small page."""


def write_html(
    frames: Frames,
    path: str | Path,
    *,
    skin: bool = True,
    title: str = "worm3d",
    script: str | Path | None = None,
    without: Collection[str] = (),
) -> None:
    """Write the run as an HTML file that needs no network. The same frames always give the same bytes.

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
    script : str or Path, optional
        File for the script of the viewer. The file is written, and the page loads the file. Several pages can share the
        file. The data of the page are compressed, and motions are rounded to 1/16000 of each number. The page is then
        many times smaller. Page and file must be moved together, and the page needs a browser of 2023 or later. By
        default, the script is a part of the page, and the page is complete.
    without : collection of str
        Layers to leave out of the page, from `LAYERS`. Pages without links are about half as large.

    Raises
    ------
    ValueError
        A name in `without` is not a layer.
    """
    address = None if script is None else _shared(Path(script), Path(path))
    Path(path).write_text(
        html(frames, skin=skin, title=title, script=address, without=without), encoding="utf-8", newline="\n"
    )


def _shared(script: Path, page: Path) -> str:
    """Write the script of the viewer into a file, and return the address of the file for a page."""
    script.write_text(recorder.script(), encoding="utf-8", newline="\n")
    return quote(Path(os.path.relpath(script, page.parent)).as_posix())


def html(
    frames: Frames,
    *,
    skin: bool = True,
    title: str = "worm3d",
    script: str | None = None,
    without: Collection[str] = (),
) -> str:
    """Return the page that `write_html` writes. `script` is the address of the file with the viewer's script."""
    if unknown := sorted({*without} - LAYERS.keys()):
        raise ValueError(f"without: got {', '.join(unknown)}, must be names of layers: {', '.join(LAYERS)}")
    scales = Scales.of(frames)
    cover = Skin.of(frames, scales.strain) if skin and "skin" not in without else None
    parts = [part for part in _parts(frames, scales, cover) if part.layer not in without]
    bits, data = (ALL_BITS, _plain) if script is None else (SMALL_BITS, _small)
    about, messages = scene(frames, parts, scales, cover, bits), commands(frames, parts, bits)
    return _page({"title": escape(title), **data(about, messages)}, script)


def live_page(title: str = "worm3d") -> str:
    """Return the page of a run that goes on. Scene and frames come from the server of the page."""
    return _page({"title": escape(title), "scene": "", "commands": "", "form": "live"}, None)


def _page(contents: Mapping[str, str], script: str | None) -> str:
    """Return a page with the given contents. `script` is as in `html`."""
    live = contents["form"] == "live"
    return filled(
        "viewer.html",
        live=live,
        style=resource("viewer.css") + resource("play.css") * live,
        script=resource("tools.js") + resource("play.js") * live + resource("viewer.js"),
        meshcat=_player(contents, script),
        **contents,
    )


def _parts(frames: Frames, scales: Scales, cover: Skin | None) -> list[Piece]:
    return [
        *pieces.worm(frames, scales),
        *pieces.contact(frames, scales),
        *pieces.way(frames),
        *pieces.world(frames.world),
        *([] if cover is None else [cover.piece()]),
    ]


def _plain(scene: dict[str, Any], messages: list[bytes]) -> dict[str, str]:
    """Return the data of a page as text."""
    return {
        "scene": _json(scene, lambda array: base64.b64encode(array.tobytes()).decode("ascii")),
        "commands": "\n".join(base64.b64encode(message).decode("ascii") for message in messages),
        "form": "plain",
    }


def _small(scene: dict[str, Any], messages: list[bytes]) -> dict[str, str]:
    """Return the data of a page as compressed text. Arrays are replaced by their places in the list of parts."""
    return {"scene": packed(with_arrays(scene)), "commands": packed(messages), "form": "packed"}


def with_arrays(about: Mapping[str, Any]) -> list[bytes]:
    """Return data as JSON, followed by the arrays in the data. In the JSON, arrays are their places in the list."""
    arrays = [b""]

    def placed(array: NDArray[np.float32]) -> int:
        arrays.append(array.tobytes())
        return len(arrays) - 1

    arrays[0] = _json(about, placed).encode()
    return arrays


def _json(scene: Mapping[str, Any], array: Callable[[NDArray[np.float32]], str | int]) -> str:
    """Return the data of a page as JSON. `array` writes an array."""
    return json.dumps(scene, separators=(",", ":"), allow_nan=False, default=array).replace("<", "\\u003c")


def _player(contents: Mapping[str, str], address: str | None) -> str:
    """Return the element with the script of meshcat's viewer, or with the address of the file."""
    if address is None:
        return f"<script>\n{recorder.script()}\n</script>"
    return policy.script_file(address, "".join(contents.values()))


@dataclass(frozen=True)
class NotebookView:
    """The value of a notebook cell that displays a page. The page is stored in the notebook and needs no server."""

    page: str = field(repr=False)
    """HTML of the page."""
    height: int = 520
    """Height of the cell [pixel]."""

    def open(self) -> Path:
        """Open the page in a browser, and return the temporary file of the page."""
        with NamedTemporaryFile("w", prefix="worm3d-", suffix=".html", encoding="utf-8", delete=False) as file:
            file.write(self.page)
        webbrowser.open(Path(file.name).as_uri(), new=2)
        return Path(file.name)

    def _repr_html_(self) -> str:
        return (
            f'<iframe srcdoc="{escape(self.page, quote=True)}" style="width: 100%; height: {self.height}px; border: 0" '
            'title="worm3d viewer"></iframe>'
        )


def commands(frames: Frames, parts: list[Piece], bits: int = ALL_BITS) -> list[bytes]:
    """Return packed commands of meshcat that set the stage, place all pieces in the first frame, and define motions.

    Motions are rounded to `bits` bits, as by `recorder.shortened`.
    """
    placed = (command for part in parts for command in recorder.place(part))
    motion = recorder.animate(parts, frames.time - frames.time[0], bits)
    return [recorder.packed(command) for command in (*recorder.stage(), *placed, motion)]


def filled(template: str, *inner: str, live: bool = False, **parts: str) -> str:
    """Return a template of the folder `page` whose placeholders are replaced by `parts` and by the policy of the page.

    All parts are inserted in a single pass, so that a part may contain text that looks like a placeholder. `inner` are
    pages that this page contains in frames. A `live` page connects to the server.
    """
    later = {"policy": "{{policy}}"}  # stays in place in this pass, because the policy depends on the filled page
    page = re.sub(r"\{\{(\w+)\}\}", lambda name: (parts | later)[name[1]], resource(template))
    return page.replace("{{policy}}", policy.of_page(page, *inner, live=live), 1)


def resource(name: str) -> str:
    """Return the text of a file of the folder `page`."""
    return files("worm3d.viewer").joinpath("page", name).read_text(encoding="utf-8")


PLOTS = (
    {"name": "speed", "title": "speed", "unit": "mm/s", "factor": 1e3},
    {"name": "strain", "title": "strain of the segments", "unit": "%", "factor": 100.0},
    {"name": "load", "title": "load of the segments", "unit": "N", "factor": 1.0},
    {"name": "energy", "title": "energy: work of the actuators, lost to friction", "unit": "J", "factor": 1.0},
)
"""Plots beside the worm, in this order. The name is a field of the page's data. A plot without data is left out."""


def plotted(frames: Frames) -> dict[str, FloatArray]:
    """Return the values of plots by name: the mean strain of each segment, and its load [N], each of shape (T, N)."""
    found = {"strain": frames.chamber_strain.mean(axis=2)}
    if frames.contact_force is not None:
        found["load"] = np.linalg.norm(frames.contact_force, axis=3).sum(axis=2)
    return found


def scene(frames: Frames, parts: list[Piece], scales: Scales, skin: Skin | None, bits: int) -> dict[str, Any]:
    """Return the data of the page, except for meshcat's commands. Skin and plots are rounded to `bits` bits."""
    eye, look = camera.inside(frames)
    low, high = frames.extent
    ahead = frames.heading
    azimuth, ground = camera.azimuths(frames), camera.floor(frames.world)
    plots = {name: shortened(values, bits) for name, values in plotted(frames).items()}
    return {
        **plots,
        "plots": [plot for plot in PLOTS if plot["name"] in plots or (plot["name"] == "speed" and len(frames) > 1)],
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
        "skin": None if skin is None else _skin(skin, bits),
        "trail": _trail(frames, parts),
        "legend": {
            "strain": scales.strain,
            "colours": [colours.as_hex(colour) for colour in colours.RAMP],
            "force": None if frames.contact_force is None else scales.force,
            "arrow": pieces.arrow_length(frames.body_length),
        },
    }


def _skin(skin: Skin, bits: int) -> dict[str, Any]:
    """Return the data of the skin for the page: the sections, and the weights of their points and colours."""
    return {
        "sections": shortened(skin.sections, bits),
        "tint": shortened(skin.tint, bits),
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


def _floats(values: ArrayLike | None) -> NDArray[np.float32] | None:
    return None if values is None else np.ascontiguousarray(values, dtype="<f4")
