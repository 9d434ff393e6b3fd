"""Run the 3D worm."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from worm3d.physics.friction import Friction
from worm3d.physics.worm import Worm
from worm3d.recorded.state import State
from worm3d.results.result import Result
from worm3d.running.accuracy import begin
from worm3d.running.actuation import Actuation, Sensor
from worm3d.running.places import place_kept
from worm3d.running.plant import MIN_NEWTON_TOLERANCE
from worm3d.running.problem import Force, Held, Integrator, Problem
from worm3d.running.run import Observer, Run
from worm3d.running.view import View, watched
from worm3d.values import arguments
from worm3d.values.spelling import spelled
from worm3d.worlds import World

if TYPE_CHECKING:
    from worm3d.running.live import Live


@spelled
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
    tolerance: float = MIN_NEWTON_TOLERANCE,
    accuracy: float | None = None,
    observer: Callable[[float, View], bool | None] | None = None,
    every: int = 10,
    live: Live | None = None,
) -> Result:
    """Simulate a worm.

    Parameters
    ----------
    worm : Worm
    world : World or None
        World that the worm crawls on or in; None means free flight.
    ground : Friction, optional
        Coefficients of friction; `Friction()` if left out.
    actuation : gait, controller, or function of time, optional
        Gives the commands (`worm3d.running.actuation`); None means no commands. If the actuation has a number `period`
        [s], the result has the mean speed over such periods.
    duration, dt : float
        Simulated time, rounded to whole time steps, and time step [s]. With an `accuracy` dt is the time between two
        rows, and between two decisions of a controller.
    integrator : str
        "bdf2" (second order) or "implicit_euler" (the integrator of the paper).
    gravity : array_like, shape (3,)
        Gravity [m/s^2].
    external_force : callable, optional
        Time [s] -> forces on the joints, shape (N+1, 3) [N].
    state : State, optional
        Initial state of the run; a straight worm along x on the world if left out. The final `Result.state` of a run
        continues that run, bit for bit if all other arguments are the same (a controller restarts: its `reset` is
        called).
    held : Held or array_like of bool, shape (N+1, 3), optional
        Coordinates (of the joints) that stay fixed.
    sensor : callable, optional
        Turns an `Observation` into the measurement for a controller; None passes the observation itself.
    record_every : int
        Steps between two rows of the result; a divisor of the number of steps.
    settle_first : bool, optional
        Whether a worm that starts at rest is first settled: brought to equilibrium on the world, under the weight that
        presses the worm to the world. On uneven worlds friction also acts, unless the worm would slide away. If left
        out, a worm that touches the world is settled, and a worm in mid-air falls. A state with memory is never
        settled. `Result.settling` is the largest displacement of a joint during settling [m], None without settling.
    tolerance : float
        Newton's tolerance: motion as a fraction of the body length, from 2e-15 (rounding) to 1e-7; 1e-9 is a fifth
        faster.
    accuracy : float, optional
        Largest error of the distance, relative to the larger of the distance and a tenth of the body length; from 1e-4
        to 0.1. The error then limits the length of each step, and the run is repeated with finer steps until the last
        runs agree; `Result.error_estimate` has the estimated errors. None: steps of dt, with an unknown error.
    observer : callable, optional
        Called with the time [s] and a read-only `worm3d.View` of the run: at the start, after every `every`-th step and
        after the last step. Returning False ends the run. An exception in the observer ends the run too; the result has
        the finished steps and the error message. The numbers of the run do not depend on the observer.
    every : int
        Steps between two calls of the observer. With an `accuracy`, calls are at the next multiple of 0.1 s, and start
        again if a run was not accurate enough.
    live : Live, optional
        Shows the run in a browser during the simulation (`worm3d.Live`); the simulation then runs no faster than the
        display.

    Returns
    -------
    Result
        Result with all finished steps, however the run ended: see `Result.stop`.

    Raises
    ------
    worm3d.LimitPointError
        The weight would flatten the chambers.
    worm3d.StateError
        The state does not fit the worm or lies inside the world, or the terrain is finer than the worm's contact
        points.
    ValueError
        Another argument is out of range or has the wrong shape.
    """
    if observer is not None:
        arguments.function("observer", observer, "a function of the time and the view of a run, or None")
    arguments.whole("every", every)
    if live is not None and not hasattr(live, "follow"):
        raise ValueError(f"live: got {type(live).__name__}, must be a worm3d.Live, or None")

    problem = Problem(
        worm=worm,
        world=world,
        ground=ground,
        actuation=actuation,
        duration=duration,
        dt=dt,
        integrator=integrator,
        gravity=gravity,
        external_force=external_force,
        state=state,
        held=held,
        sensor=sensor,
        record_every=record_every,
        settle_first=settle_first,
        tolerance=tolerance,
        accuracy=accuracy,
    )

    def observers(run: Run) -> list[Observer]:
        shown = [] if live is None else [live.follow(run)]
        return [*shown, *([] if observer is None else [watched(observer, every)])]

    return begin(problem, place_kept, observers)()
