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
        World that the worm crawls on or in. None means free flight.
    ground : Friction, optional
        Coefficients of friction. If it is left out, the default is `Friction()`.
    actuation : gait, controller, or function of time, optional
        Source of the commands (`worm3d.running.actuation`). None means no commands. If the actuation has a `period`
        [s], the mean speeds in the result are averaged over whole periods.
    duration, dt : float
        Simulated time, which is rounded to a whole number of time steps, and time step [s]. If `accuracy` is given, dt
        is the interval between two rows of the result, and between two calls of a controller.
    integrator : str
        "bdf2" (second order) or "implicit_euler" (the integrator of the paper).
    gravity : array_like, shape (3,)
        Gravity [m/s^2].
    external_force : callable, optional
        Function of time [s] that returns the forces on the joints, shape (N+1, 3) [N].
    state : State, optional
        Initial state of the run. If it is left out, a straight worm along x lies on the world. A run that starts from
        the `Result.state` of another run continues that run. If all other arguments are the same, the results are equal
        bit for bit to an uninterrupted run. Controllers are an exception, because their `reset` is called at the start.
    held : Held or array_like of bool, shape (N+1, 3), optional
        Coordinates that stay fixed. An array marks coordinates of the joints.
    sensor : callable, optional
        Function that turns an `Observation` into the measurement for a controller. With None, the controller gets the
        observation itself.
    record_every : int
        Number of steps between two rows of the result. It must divide the number of steps.
    settle_first : bool, optional
        Whether a worm that starts at rest is first settled, i.e. brought to equilibrium on the world under the part of
        its weight that presses it against the world. On uneven worlds friction also acts, unless the worm would slide
        away. If the argument is left out, a worm that touches the world is settled, and a worm in mid-air falls. A
        worm that starts from a state with memory is never settled. `Result.settling` is the largest displacement of a
        joint during settling [m], or None without settling.
    tolerance : float
        Tolerance of Newton's method, as a motion divided by the body length, from 2e-15 (rounding errors) to 1e-7. With
        1e-9, a run takes a fifth less time.
    accuracy : float, optional
        Largest error of the distance, relative to the larger of the distance and a tenth of the body length, from 1e-4
        to 0.1. The length of each step is then adapted to an allowed error, and the run is repeated with finer steps
        until the last runs agree. `Result.error_estimate` has the estimated errors. With None, all steps have the
        length dt, and the error is unknown.
    observer : callable, optional
        Function of the time [s] and a read-only `worm3d.View` of the run. It is called at the start, after every
        `every` steps, and after the last step. The run ends if the function returns False or raises an exception. After
        an exception, the result has the finished steps and the error message. The observer does not change the numbers
        of the run.
    every : int
        Number of steps between two calls of the observer. If `accuracy` is given, each call is delayed to the next
        multiple of 0.1 s. If a run is repeated because it was not accurate enough, the calls start again.
    live : Live, optional
        Shows the run in a browser during the simulation (`worm3d.Live`). The simulation then waits for the display.

    Returns
    -------
    Result
        Result with all finished steps. `Result.stop` says how the run ended.

    Raises
    ------
    worm3d.LimitPointError
        The weight would flatten the chambers.
    worm3d.StateError
        The state does not fit the worm, the worm lies inside the world, or the terrain has bumps that would pass
        between the contact points of the worm.
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
