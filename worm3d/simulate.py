"""Run the 3D worm."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from worm3d.actuation import Actuation, Driver, Sensor
from worm3d.constraints import Held, held_mask
from worm3d.physics.friction import Friction
from worm3d.plant import ROUNDING
from worm3d.result import Result
from worm3d.run import Force, Run
from worm3d.solver import arrays
from worm3d.start import Placed, place
from worm3d.state import State
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.memory import bytes_of_run, require_room
from worm3d.worlds import ClampedGround, World
from worm3d.worm import Worm

if TYPE_CHECKING:
    from worm3d.live import Live

Integrator = Literal["bdf2", "implicit_euler"]

COARSEST = 1e-7
"""Greatest tolerance: contacts stick within a tenth of a micrometre."""

SHORTEST = 1e-6
"""Time step [s]: Newton no longer converges to rounding in shorter ones, and takes a hundred times the iterations."""

FARTHEST = 1e10
"""Time steps from time 0 at which a state may begin: farther away rounding makes them unequal."""

Placing = Callable[[Worm, World | None, Friction, FloatArray, NDArray[np.bool_], State | None, bool | None], Placed]
"""As `worm3d.start.place`."""


def simulate(
    worm: Worm,
    world: World | None,
    ground: Friction | None = None,
    actuation: Actuation | None = None,
    duration: float = 10.0,
    dt: float = 0.01,
    integrator: Integrator = "bdf2",
    gravity: ArrayLike = (0.0, 0.0, -9.81),
    external_force: Force | None = None,
    state: State | None = None,
    held: Held | ArrayLike | None = None,
    sensor: Sensor | None = None,
    record_every: int = 1,
    *,
    settle_first: bool | None = None,
    tolerance: float = ROUNDING,
    observer: Callable[[int], bool] | None = None,
    live: Live | None = None,
) -> Result:
    """Simulate a worm.

    Parameters
    ----------
    worm : Worm
    world : World or None
        What it crawls on or in; None: nothing, as in free flight.
    ground : Friction, optional
        Coefficients of friction; `Friction()` if left out.
    actuation : gait, controller, or function of time, optional
        Gives the commands (`worm3d.actuation`); left alone if None. Where it has a number `period` [s], the result has
        the mean speed over such periods.
    duration, dt : float
        Simulated time, rounded to whole time steps, and time step [s].
    integrator : str
        "bdf2" (second order) or "implicit_euler" (the paper's).
    gravity : array_like, shape (3,)
        [m/s^2]
    external_force : callable, optional
        Time [s] -> forces on the joints, shape (N+1, 3) [N].
    state : State, optional
        Where the run starts; a straight worm along x on the world if left out. The final `Result.state` of a run
        goes on with it, bit for bit if all else is the same (a controller begins anew: its `reset` is called).
    held : Held or array_like of bool, shape (N+1, 3), optional
        Coordinates (of the joints) that stay fixed.
    sensor : callable, optional
        Makes of an `Observation` the measurement that a controller gets; None: the observation.
    record_every : int
        Steps between two rows of the result; a divisor of their number.
    settle_first : bool, optional
        Whether a worm that starts at rest is first brought to equilibrium on its world, under the weight that presses
        it there; on uneven worlds by its friction too, unless that lets it slide away. If left out: where it touches
        the world; what starts in mid-air falls. A state with memory never is. `Result.settling` says what was done.
    observer : callable, optional
        Called with the number of finished steps, every so many (after every step, if the actuation is a controller) and
        whenever it divides by `record_every`, unless rows follow closely; returning False ends the run there.
    live : Live, optional
        Shows the run in a browser while it goes on (`worm3d.Live`), no faster than that is to show it.

    Returns
    -------
    Result
        With all finished steps, however the run ended: see `Result.stop`.

    Raises
    ------
    worm3d.LimitPointError
        The weight would flatten the chambers.
    worm3d.StateError
        A state that does not fit the worm, or lies inside the world; terrain finer than the worm's contact points.
    ValueError
        Another argument out of range or of the wrong shape.
    """
    if observer is not None:
        arguments.function("observer", observer, "a function of the number of finished steps, or None")
    if live is not None and not hasattr(live, "follow"):
        raise ValueError(f"live: got {type(live).__name__}, must be a worm3d.Live, or None")
    run = prepare(
        worm,
        world,
        ground,
        actuation,
        duration,
        dt,
        integrator,
        gravity,
        external_force,
        state,
        held,
        sensor,
        record_every,
        settle_first=settle_first,
        tolerance=tolerance,
    )
    return run.finish(observer if live is None else live.follow(run, observer))


def prepare(
    worm: Worm,
    world: World | None,
    ground: Friction | None,
    actuation: Actuation | None,
    duration: float,
    dt: float,
    integrator: Integrator,
    gravity: ArrayLike,
    external_force: Force | None,
    state: State | None,
    held: Held | ArrayLike | None,
    sensor: Sensor | None,
    record_every: int,
    *,
    settle_first: bool | None,
    tolerance: float = ROUNDING,
    placing: Placing = place,
) -> Run:
    """Check what `simulate` is given, and return the run before its first step; `placing` puts the worm there."""
    _require_kinds(world, ground, external_force)
    weight = _vector(gravity)
    steps = _steps(duration, dt, record_every, integrator)
    arguments.number("tolerance", tolerance, "body lengths", ge=ROUNDING, le=COARSEST)
    if settle_first is not None:
        arguments.flag("settle_first", settle_first)
    arguments.instance("worm", worm, Worm, "a worm3d.Worm")
    arguments.instance("state", state, State | None, "a worm3d.State, or None")
    _require_room(worm, steps, record_every)
    if state is not None and abs(state.time) > FARTHEST * dt:
        raise ValueError(f"state: its time of {state.time:g} s is too far from 0 for steps of {dt:g} s, must be nearer")
    friction = ground if ground is not None else Friction()
    clamped = isinstance(world, ClampedGround)
    mask = held_mask(held, worm.segments, flat=worm.flat, clamped=clamped)
    if worm.chamber_offset == 0.0 and not mask.reshape(-1, 5)[:, 4].all():
        raise ValueError("chamber_offset: got 0 with bends that are free; hold them (held.bend) or give it a width")
    placed = placing(worm, world, friction, weight, mask, state, settle_first)
    placed.plant.arrays["numbers"][0, arrays.TOLERANCE] = tolerance
    driver = Driver(actuation, worm, sensor)
    period = getattr(actuation, "period", getattr(actuation, "T_wave", None))
    return Run(placed, driver, external_force, dt, integrator == "bdf2", record_every, steps, period)


def _require_kinds(world: object, ground: object, external_force: object) -> None:
    """Raise ValueError where an argument stands in the wrong place."""
    if not (world is None or isinstance(world, World)):
        raise ValueError(f"world: got {type(world).__name__}, must be a world such as worm3d.Plane(), or None")
    if not (ground is None or isinstance(ground, Friction)):
        raise ValueError(f"ground: got {type(ground).__name__}, must be a worm3d.Friction, or None for the default")
    if not (external_force is None or callable(external_force)):
        raise ValueError(f"external_force: got {type(external_force).__name__}, must be a function of time, or None")


def _require_room(worm: Worm, steps: int, every: int) -> None:
    remedy = "a larger record_every, a shorter duration, a longer dt or fewer segments"
    needed = bytes_of_run(worm.segments, steps, every)
    require_room("duration", needed, f"{steps:.3g} steps of {worm.segments} segments", remedy)


def _vector(gravity: ArrayLike) -> FloatArray:
    vector = arguments.floats("gravity", gravity)
    if vector.shape != (3,) or not (np.abs(vector) <= arguments.LARGEST).all():
        raise ValueError(f"gravity: got {arguments.shown(gravity)}, must be finite, x, y and z [m/s^2]")
    return vector


def _steps(duration: float, dt: float, every: int, integrator: str) -> int:
    """Check the numbers of a run and return its number of steps."""
    for name, value in (("duration", duration), ("dt", dt)):
        arguments.number(name, value, "s", gt=0.0)
    if dt < SHORTEST:
        raise ValueError(f"dt: got {dt!r} s, must be at least {SHORTEST:g} s: rounding shows in shorter steps")
    arguments.whole("record_every", every)
    arguments.choice("integrator", integrator, get_args(Integrator))
    steps = round(duration / dt)
    if not steps:
        raise ValueError(f"dt: got {dt:g} s, must be at most the duration of the run, {duration:g} s")
    if steps % every:
        raise ValueError(
            f"record_every: got {arguments.shown(every)}, must divide the {steps} time steps of the run: its end is "
            "kept"
        )
    return steps
