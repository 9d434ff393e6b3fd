"""Going on with a run: the scene of the whole run, from the record of its first part."""

from __future__ import annotations

import math

from scenes.language.errors import SceneError
from scenes.models.loading import Scene, parse_scene
from scenes.records.drawing import model_of
from scenes.records.record import Record


def lengthened(earlier: Record, more: float | None = None) -> Scene:
    """Return the scene of a run that goes on.

    Parameters
    ----------
    earlier : Record
        The first part, which ended as planned or was interrupted.
    more : float, optional
        Time to add [s]; if left out, to the planned end.

    Raises
    ------
    SceneError
        It cannot go on, or there is nothing more to do.
    """
    model = model_of(earlier)
    if model.resume is None or not earlier.checkpoint:
        raise SceneError(f"{earlier.name}: has no checkpoint to go on from (model '{model.name}')")
    if earlier.status not in ("done", "interrupted"):
        raise SceneError(
            f"{earlier.name}: {earlier.sentence}; it would end there again: {model.advice}, and run the scene anew"
        )
    planned = parse_scene(earlier.scene, earlier.name)
    run, done = planned.settings.run, earlier.sizes["step"]
    if done % run.record_every:
        raise SceneError(
            f"{earlier.name}: stopped after step {done}, between two stored states (run.record_every = "
            f"{run.record_every}): nothing could be joined to it; run the scene anew"
        )
    if more is None:
        return _to_the_planned_end(planned, done)
    if not (math.isfinite(more) and more > 0.0):
        raise SceneError(f"--duration: got {more} s, must be finite and above 0")
    if round(more / run.dt_s) < 1:
        raise SceneError(f"--duration: got {more} s, must be at least a time step (run.dt_s = {run.dt_s} s)")
    total = float(f"{done * run.dt_s + more:.12g}")  # 0.1 + 0.2 s are 0.3 s
    return parse_scene(earlier.scene, earlier.name, [f"run.duration_s={total!r}"])


def _to_the_planned_end(planned: Scene, done: int) -> Scene:
    if done >= planned.settings.steps:
        raise SceneError(
            f"{planned.name}: has come to its end ({planned.settings.run.duration_s:g} s); say how much longer it is "
            "to go on: --duration SECONDS_MORE"
        )
    return planned
