"""`worm3d play SCENE`: a run without end whose values a user changes in the browser during the run.

The run consists of parts (`LEG`). Each part starts from the state at the end of the part before, as if the run had not
been interrupted. When a user changes a value, the part ends, and the next part has the new value. Only a changed slope
moves the worm: the worm turns with the ground about the origin, and loses the contact forces for an instant.
"""

from __future__ import annotations

import math
import time
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import typer
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

import worm3d
from scenes.language.errors import SceneError
from scenes.language.reading import read
from scenes.language.schema import Key, keys_in, with_own_defaults
from scenes.models.base import Played
from scenes.models.checks import in_keys
from scenes.models.loading import Scene, parse_scene
from scenes.models.worm.build import WORM_KEYS, problem_of
from scenes.records import folder as folders
from scenes.records.folder import write_bytes
from scenes.running import runner
from scenes.running.terminal import Interruption
from worm3d.recorded.series import Recorded
from worm3d.running.live import Live
from worm3d.running.places import place_kept
from worm3d.running.problem import Problem
from worm3d.running.run import Observer, Run
from worm3d.values.arrays import FloatArray

SHOWN: Mapping[str, tuple[str, ...]] = {
    "reference": ("speed_m_s", "heading_deg"),
    "gait": (),
    "friction": ("forward", "backward", "lateral", "static_ratio"),
    "world": ("slope_deg",),
    "worm": ("mass_kg",),
}
"""Keys that have a slider, by section; all numbers and choices if there are none. They do not change the shape of the
worm, so that a run can go on with another value."""

LEG, LONGEST_RECORD = 20.0, 600.0
"""Longest part of a run, and longest part that is recorded [s]. A part of 600 s of the default worm needs 0.6 GB. With
half of `LEG`, parts would be made twice as often, which takes a frame each time. With double, more memory is in use."""

STEEPEST = 45.0
"""Largest angle that a slider sets [deg]. Other angles can be typed."""

STIFFNESS, STRONGEST, DAMPED = 2.0, 1.5, 0.3
"""Stiffness of the spring for pulls [weights of the worm per body length], and largest force of the spring [weights].
With half the stiffness, a short pull does not overcome friction. With double, the worm is lifted by accident. The
damping is critical for the mass of the worm, and at most `DAMPED` times the mass of a segment in each time step, since
the force of a step is computed before the step. With six times this value, the pull would grow from step to step."""


def play(scene: Scene, *, speed: float, opens: Callable[[str], bool]) -> int:
    """Let a user play with a scene in the browser until Ctrl-C, and return the exit code.

    Parameters
    ----------
    scene : Scene
    speed : float
        Speed at the start, simulated time over real time.
    opens : callable
        Function that opens the address of the page, and returns whether there is a browser.

    Raises
    ------
    SceneError
        If the model cannot be played, or the page cannot be started.
    """
    if scene.model.played is None:
        raise SceneError(f"{scene.name}: the model '{scene.model.name}' cannot be played; 'worm3d run' animates it")

    def began(address: str) -> None:
        seen = "seen" if opens(address) else "to be seen"
        typer.echo(f"{scene.name}: {seen} at {address}; Ctrl-C ends it")

    player = Player(scene)
    title = scene.settings.title or scene.name
    with Interruption() as going, Live(speed=speed, began=began, title=title, horizon=player.horizon) as live:
        live.player, live.goes_on = player, lambda: not going.requested
        try:
            while not going.requested:
                player.leg(live)
        except ConnectionError as error:
            raise SceneError(str(error)) from error
    typer.echo(f"{scene.name}: ended by {going.cause}")
    return 0


class Player:
    """The run of a scene, and the answers to the controls of the page (`worm3d.running.live.Player`)."""

    def __init__(self, scene: Scene) -> None:
        self.scene = self._good = self._first = scene
        assert scene.model.played is not None
        self.played: Played = scene.model.played(scene.settings)
        self._state: worm3d.State | None = None
        self._run: Run | None = None
        self._next: Callable[[], None] | None = None
        self._records = self._asked_to_record = False
        self._says = ""
        self._grip: tuple[int, float] | None = None
        self._pointer = self._off = np.zeros(3)

    # ------------------------------------------------------------------ parts of the run
    def leg(self, live: Live) -> None:
        """Run until a value changes, or to the end of a part."""
        self._records, self._asked_to_record = self._asked_to_record, False
        self._run = None
        self.played.forget()
        run, anew = self._begun(), self._state is None
        self._run, self._state, self._next = run, None, None
        result = run.finish(live.follow(run), Observer(lambda run: live.goes_on(), run.every))
        self._state = run.state()
        failed = result.status not in (worm3d.Status.DONE, worm3d.Status.INTERRUPTED)
        if self._records:
            self._keep(result if failed else run.result(worm3d.Status.DONE))
        if failed and anew and run.done == 0:
            self._go_back(result.stop.sentence)
        elif failed:
            self._says = f"{result.stop.sentence}; back at the start, with the same values"
            self._next, live.held = self._reset, True
        if self._next is not None:
            self._next()

    def _begun(self) -> Run:
        """Return the next part of the run: from the present state if possible, with the values if possible."""
        try:
            run = Run(self._problem(self.scene, self._turned()), place_kept)
        except (worm3d.StateError, worm3d.LimitPointError, ValueError) as error:
            self._says, state = in_keys(str(error), WORM_KEYS), self._state
            if self.scene is self._good and state is None:
                self._go_back(self._says)
            elif self.scene is self._good:
                self._says += "; the run begins anew"
                self._reset()
            else:
                self._says += "; the value before is kept"
                self.scene = self._good
                self.played.follow(self.scene.settings, 0.0 if state is None else state.time)
            return self._begun()
        self._good = self.scene
        return run

    def _problem(self, scene: Scene, state: worm3d.State | None) -> Problem:
        """Return the next part of the run as the problem for the solver."""
        problem = problem_of(scene.settings, state, drive=self.played.drive())
        base, longest = problem.external_force, LONGEST_RECORD if self._records else LEG

        def force(t: float) -> FloatArray:
            total = np.zeros((problem.worm.segments + 1, 3)) if base is None else np.array(base(t), dtype=float)
            if self._grip is not None and self._run is not None:
                (i, share), (_, pull) = self._grip, self._spring(self._run)
                total[i] += (1.0 - share) * pull
                total[i + 1] += share * pull
            return total

        duration = max(1, round(longest / problem.dt)) * problem.dt
        return replace(problem, duration=duration, accuracy=None, record_every=1, external_force=force)

    def _reset(self) -> None:
        """Let the run begin again, with the present values."""
        begins = self.scene.model.played
        assert begins is not None
        self._state, self._grip = None, None
        try:
            self.played = begins(self.scene.settings)
        except SceneError as error:
            self._says = f"{error}; the controller of the scene without changes is kept"
            self.played = begins(self._first.settings)
            self.played.follow(self.scene.settings, 0.0)

    def _go_back(self, why: str) -> None:
        """Let the run begin again, with the values of the scene; SceneError if they are the present ones already."""
        if self.scene is self._first:
            raise SceneError(f"{self.scene.name}: {why}")
        self.scene = self._good = self._first
        self._reset()
        self._says = f"{why}; back at the start, with the values of the scene"

    def _turned(self) -> worm3d.State | None:
        """Return the present state, turned with the ground if its slope has changed. Contacts then begin anew."""
        state, world = self._state, self.scene.settings.world
        if state is None or world == self._good.settings.world:
            return state
        turn = slope_of(self.scene) * slope_of(self._good).inv()
        moved = {name: getattr(state, name) @ turn.as_matrix().T for name in ("joints", "directors", "joint_velocity")}
        return state.with_changes(**moved)

    def _keep(self, result: worm3d.Result) -> None:
        """Write a folder with the last part of the run, as `worm3d run` does."""
        duration = float(result.time[-1] - result.time[0])
        if duration <= 0.0:
            return
        scene = with_values(self._good, "run", {"duration_s": duration, "record_every": 1})
        assert scene.model.recorded is not None
        try:
            record = runner.record_of(scene, scene.model.recorded(scene.settings, self.played, result))
            with folders.prepared(None, scene.name, force=False) as folder:
                runner.keep(record, folder)
                runner.draw(record, scene, folder)
        except SceneError as error:
            self._says = str(error)
        else:
            self._says = f"recorded: {folder}; 'worm3d view {folder}' shows it"

    # ------------------------------------------------------------------ the page
    def controls(self) -> Mapping[str, Any]:
        """Return the sliders, and the text about the arrow keys."""
        keys = [control(key, known, value) for key, (known, value) in sliders(self.scene).items()]
        return {"keys": keys, "steers": self.played.steers}

    def state(self) -> Mapping[str, Any]:
        """Return the present values and messages."""
        values = {key: value for key, (_, value) in sliders(self.scene).items()}
        return {
            "values": values,
            "says": self._says,
            "recording": self._records,
            "steered": self.played.state(),
        }

    def horizon(self, time: float, com: FloatArray) -> FloatArray | None:
        """Return the path that the controller expects."""
        return self.played.horizon(time, com)

    def path(self, com: FloatArray) -> FloatArray | None:
        """Return the path near the worm."""
        return self.played.path(com)

    def values(self, run: Run, now: Recorded) -> Mapping[str, ArrayLike]:
        """Return the spring that pulls the worm, and the speed that the worm has to keep."""
        push = np.zeros(7)
        if self._grip is not None:
            at, pull = self._spring(run)
            push = np.array([*at, *self._pointer, np.linalg.norm(pull)])
        wanted = self.played.wanted(float(now.time[0]))
        return {"push": push, **({} if wanted is None else {"reference_speed": wanted})}

    def _spring(self, run: Run) -> tuple[FloatArray, FloatArray]:
        """Return the place where the worm is held [m], and the force of the spring on it [N], each of shape (3,)."""
        assert self._grip is not None
        i, share = self._grip
        beside, worm = np.array([1.0 - share, share]), run.plant.worm
        at, speed = (run.plant.arrays[name][:3, i : i + 2] @ beside for name in ("joints", "joint_velocity"))
        weight = worm.mass * float(np.linalg.norm(run.plant.gravity))
        stiffness = STIFFNESS * weight / worm.length
        damping = min(2.0 * math.sqrt(stiffness * worm.mass), DAMPED * worm.mass / (worm.segments * run.dt))
        pull = stiffness * (self._pointer - at) - damping * speed
        size = float(np.linalg.norm(pull))
        return at, pull * min(1.0, STRONGEST * weight / max(size, 1e-300))

    def answer(self, run: Run, message: Mapping[str, Any]) -> bool:
        """Obey a message. Return whether this part of the run goes on."""
        does = getattr(self, f"_do_{message.get('do')}", None)
        try:
            return True if does is None else bool(does(run, message))
        except (SceneError, ValueError) as error:
            self._says = str(error)
            return True

    def _do_set(self, run: Run, message: Mapping[str, Any]) -> bool:
        return self._set(run, {str(message.get("key")): message.get("value")})

    def _do_steer(self, run: Run, message: Mapping[str, Any]) -> bool:
        left, up = (float(np.sign(value)) for value in numbers(message.get("value"), 2))
        return self._set(run, self.played.steer(left, up, float(run.observation().heading)))

    def _do_unsteer(self, run: Run, message: Mapping[str, Any]) -> bool:
        self.played.steer(0.0, 0.0, 0.0)
        return True

    def _set(self, run: Run, values: Mapping[str, Any]) -> bool:
        """Change values of the scene. Return whether this part of the run can go on."""
        before = scene = self.scene
        for key, value in values.items():
            scene = changed(scene, key, value)
        self.played.follow(scene.settings, run.time(run.done))
        self.scene, self._says = scene, ""
        sections = {name for name, section in scene.settings if section != getattr(before.settings, name)}
        return sections <= {"reference"}

    def _do_grab(self, run: Run, message: Mapping[str, Any]) -> bool:
        place = numbers(message.get("value"), 3)
        joints = run.plant.arrays["joints"][:3, : run.n + 1].T
        edges = np.diff(joints, axis=0)
        shares = np.clip(((place - joints[:-1]) * edges).sum(axis=1) / (edges**2).sum(axis=1), 0.0, 1.0)
        i = int(np.linalg.norm(joints[:-1] + shares[:, None] * edges - place, axis=1).argmin())
        self._grip = i, float(shares[i])
        self._pointer = joints[i] + shares[i] * edges[i]
        self._off = place - self._pointer
        return True

    def _do_pull(self, run: Run, message: Mapping[str, Any]) -> bool:
        if self._grip is not None:
            self._pointer = numbers(message.get("value"), 3) - self._off
        return True

    def _do_let_go(self, run: Run, message: Mapping[str, Any]) -> bool:
        self._grip = None
        return True

    def _do_reset(self, run: Run, message: Mapping[str, Any]) -> bool:
        self._next, self._says = self._reset, "back at the start"
        return False

    def _do_record(self, run: Run, message: Mapping[str, Any]) -> bool:
        self._asked_to_record = not self._records
        return False

    def _do_save(self, run: Run, message: Mapping[str, Any]) -> bool:
        path, text = Path(f"{self.scene.name}-{time.strftime('%Y%m%d-%H%M%S')}.toml"), self.scene.to_toml()
        parse_scene(text, self.scene.name)  # the values fit together
        write_bytes(path, text.encode())
        self._says = f"saved: {path}; 'worm3d run {path}' runs it"
        return True


def numbers(given: Any, count: int) -> FloatArray:
    """Return numbers of a message, shape (count,), of sizes that a page can show. ValueError if they are others."""
    try:
        found = np.array(given, dtype=float)
    except (TypeError, ValueError, OverflowError):
        found = np.zeros(0)
    if found.shape != (count,) or not (np.abs(found) < 1e30).all():
        raise ValueError(f"message: got {given!r:.60}, must be {count} numbers")
    return found


def kind_key(section: Any) -> str:
    """Return the name of the key that chooses the kind of a section."""
    return next(filter(None, getattr(type(section), "holds", ())), "kind")


def sliders(scene: Scene) -> dict[str, tuple[Key, Any]]:
    """Return the keys of `SHOWN` that have a number or a choice, with their values, by section.key."""
    found: dict[str, tuple[Key, Any]] = {}
    for section, names in SHOWN.items():
        part = getattr(scene.settings, section, ())
        kind, known = getattr(part, kind_key(part), None), keys_in(type(part)) if part else {}
        for name, value in part:
            key = known[name]
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if (
                (name in names or not names)
                and key.is_for(kind)
                and (number or (key.choices and isinstance(value, str)))
            ):
                found[f"{section}.{name}"] = key, value
    return found


def control(name: str, key: Key, value: Any) -> dict[str, Any]:
    """Return a slider or a choice, as `worm3d.viewer.live.LiveView` describes.

    Without bounds, a slider reaches from 0, or from minus the largest value, to four times the present value.
    """
    about = {"key": name, "value": value, "unit": key.unit, "meaning": key.meaning_in_section}
    if isinstance(value, str):
        return {**about, "choices": [*dict.fromkeys([*key.choices, value])]}
    far, bounds = 4.0 * abs(value) or 1.0, key.bounds
    low, high = (
        bounds.get("ge", bounds.get("gt", -far if value < 0.0 else 0.0)),
        bounds.get("le", bounds.get("lt", far)),
    )
    low, high = (max(low, -STEEPEST), min(high, STEEPEST)) if key.unit == "deg" else (low, min(high, far))
    if key.unit == "deg" and not bounds:
        low, high = -STEEPEST, STEEPEST
    return {**about, "low": low + (high - low) / 100.0 if "gt" in bounds else low, "high": high}


def changed(scene: Scene, name: str, value: Any) -> Scene:
    """Return a scene with another value of a slider. If a kind changes, the other keys get their defaults.

    Raises
    ------
    SceneError
        The scene has no such slider, or the value is out of range.
    """
    if name not in (known := sliders(scene)):
        raise SceneError(f"{name!r:.60}: this scene has no such control")
    section, _, key = name.partition(".")
    about, _ = known[name]
    if about.is_number:
        number = float(numbers([value], 1)[0])
        value = round(number) if about.is_whole else float(f"{number:.6g}")
    elif value not in about.choices:
        raise SceneError(f"{name}: got {value!r:.60}, must be one of {', '.join(about.choices)}")
    return with_values(scene, section, {key: value})


def with_values(scene: Scene, section: str, values: Mapping[str, Any]) -> Scene:
    """Return a scene with other values in a section; SceneError if a value is out of range."""
    data = tomllib.loads(scene.to_toml())
    data["run"].pop("accuracy", None)
    part = getattr(scene.settings, section)
    if (by := kind_key(part)) in values and by in keys_in(type(part)):
        data[section] = {"period_s": part.period_s} if keys_in(type(part))["period_s"].is_for(values[by]) else {}
    data[section] |= values
    settings, wrong = read(scene.model.schema, with_own_defaults(scene.model.schema, data))
    if settings is None:
        raise SceneError(*(f"{'.'.join(map(str, each.path))}: got {each.found!r}: {each.text}" for each in wrong))
    return replace(scene, settings=settings)


def slope_of(scene: Scene) -> Rotation:
    """Return the rotation of the ground of a scene from the level."""
    world = scene.settings.world
    slope, azimuth = (math.radians(getattr(world, name, 0.0)) for name in ("slope_deg", "heading_deg"))
    return Rotation.from_rotvec(slope * np.array([math.sin(azimuth), -math.cos(azimuth), 0.0]))
