"""Many runs at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from numpy.typing import ArrayLike

from worm3d.physics.friction import Friction
from worm3d.physics.worm import Worm
from worm3d.recorded.state import State, StateError
from worm3d.results.result import Result
from worm3d.running.accuracy import begin
from worm3d.running.actuation import Actuation
from worm3d.running.places import Places
from worm3d.running.plant import MIN_NEWTON_TOLERANCE
from worm3d.running.problem import Force, Held, Integrator, Problem
from worm3d.running.start import LimitPointError
from worm3d.values import arguments
from worm3d.values.spelling import spelled
from worm3d.worlds import World


@spelled
def simulate_batch(
    worm: Worm | Sequence[Worm],
    world: Sequence[World | None] | World | None,
    ground: Sequence[Friction | None] | Friction | None = None,
    actuation: Sequence[Actuation | None] | Actuation | None = None,
    duration: float = 10.0,
    dt: float = 0.01,
    integrator: Integrator = "bdf2",
    gravity: ArrayLike = (0.0, 0.0, -9.81),
    external_force: Sequence[Force | None] | Force | None = None,
    state: Sequence[State | None] | State | None = None,
    held: Held | None = None,
    record_every: int = 1,
    *,
    settle_first: bool | None = None,
    tolerance: float = MIN_NEWTON_TOLERANCE,
    accuracy: float | None = None,
    threads: int = 1,
) -> list[Result]:
    """Simulate many worms. The results are equal to the results of `simulate`, bit for bit.

    Equal worms on the same world are placed and settled only once. On a single thread, this is the only saving of a
    batch, and it is largest for short runs. Runs are not combined in vector instructions, because these already process
    several segments of a worm at once (`.docs/evidence/speed.md`).

    Parameters
    ----------
    worm, world, ground, actuation, external_force, state
        As in `simulate`. Each argument is a single value for all runs, or a list or tuple with a value for each run. At
        least one of these arguments must be a list or tuple.
    duration, dt, integrator, gravity, held, record_every, settle_first, tolerance, accuracy
        As in `simulate`, for all runs.
    threads : int
        Number of simultaneous runs. With several threads, an actuation or force that is shared by several runs is
        called from several threads.

    Returns
    -------
    list of Result
        Results in the order of the arguments. If a run stops early, for example because of an error in an actuation or
        force, the other runs go on.

    Raises
    ------
    ValueError
        The lists have different lengths, or `simulate` refuses an argument. The error is raised before any run begins.
    """
    arguments.whole("threads", threads, le=1024)
    each: dict[str, Any] = {
        "worm": worm,
        "world": world,
        "ground": ground,
        "actuation": actuation,
        "external_force": external_force,
        "state": state,
    }
    given: dict[str, Any] = {
        "duration": duration,
        "dt": dt,
        "integrator": integrator,
        "gravity": gravity,
        "held": held,
        "record_every": record_every,
        "settle_first": settle_first,
        "tolerance": tolerance,
        "accuracy": accuracy,
    }
    count = _count(each)
    own = {name: value if isinstance(value, list | tuple) else [value] * count for name, value in each.items()}
    places = Places()

    def prepared(k: int) -> Callable[[], Result]:
        try:
            return begin(Problem(**{name: values[k] for name, values in own.items()}, **given), places.place)
        except (StateError, LimitPointError) as error:
            raise type(error)(f"run {k}: {error}") from error
        except ValueError as error:
            raise ValueError(f"run {k}: {error}") from error
        except Exception as error:
            error.add_note(f"raised by the actuation of run {k} of the batch, before its first step")
            raise

    runs = [prepared(k) for k in range(count)]  # one after the other: CasADi, which worms need here, has no threads
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(lambda finish: finish(), runs))


def _count(each: Mapping[str, object]) -> int:
    sizes = {name: len(value) for name, value in each.items() if isinstance(value, list | tuple)}
    if not sizes:
        raise ValueError(
            "simulate_batch: got no list, must have one for at least one of worm, world, ground, actuation, ..."
        )
    if len(set(sizes.values())) > 1:
        got = ", ".join(f"{size} of {name}" for name, size in sizes.items())
        raise ValueError(f"simulate_batch: got {got}, lists must have one for each run")
    return next(iter(sizes.values()))
