"""Controllers and their parts by the names that scenes use.

A name is the key of a supplied class, or `module:Class` for a class of the user. Each supplied class has a row in
`CONTROLLERS`, `ESTIMATORS` or `MODELS`.

A user's controller is a class that is marked as a controller (`control.parts`) and has the class method `of(task)`. The
method takes a `control.task.ControlTask` and returns an object with the methods of `worm3d.Controller`: `reset()` and
`step(t, measurement)`, which returns a `worm3d.Command`. If `of` has no argument `task`, it gets the fields of the task
as separate arguments. If the controller is a `control.loop.WaveController`, a run also records its decisions and
estimates.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from inspect import Parameter, signature
from typing import TYPE_CHECKING, Any, NamedTuple

from control.parts import CONTROLLER, ESTIMATOR, MODEL_KIND
from control.task import ControlTask
from worm3d import Controller
from worm3d.values import named

if TYPE_CHECKING:
    from control.loop import Driver


class Listed(NamedTuple):
    """A supplied part that scenes can name."""

    title: str
    """Description for help texts."""
    module: str
    name: str
    """Name of the class in the module."""


CONTROLLERS = {
    "mpc": Listed("model predictive control of the gait's parameters", "control.supervisor", "Supervisor"),
    "climber": Listed(
        "mpc, and climbing by two anchors where the walls of a pipe close round the worm",
        "control.climbing.climber",
        "Climber",
    ),
    "bending": Listed("mpc, with a worm that also bends along the path", "control.chambers.controller", "Bending"),
    "pi_los": Listed("PI control of the speed and line-of-sight steering", "control.baselines", "PiLineOfSight"),
    "open_loop": Listed("the wave that the identified map says, without looking", "control.baselines", "OpenLoop"),
}
"""Controllers by the name that scenes use."""
ESTIMATORS = {"kalman": Listed("a Kalman filter with several beliefs", "control.estimation.estimator", "Estimator")}
"""Estimators by the name that scenes use."""
MODELS = {"reduced": Listed("the worm averaged over a wave, (R1)", "control.estimation.reduced", "ReducedModel")}
"""Models of planners and estimators by the name that scenes use."""


def controller(name: str) -> Any:
    """Return the class of a controller. The module is imported only here, since importing the solvers takes a while.

    Raises
    ------
    ValueError
        There is no such controller, or the object of this name is not a controller.
    """
    return _found(CONTROLLERS, name, CONTROLLER)


def estimator(name: str) -> Any:
    """Return the class of an estimator. Errors as for `controller`."""
    return _found(ESTIMATORS, name, ESTIMATOR)


def model(name: str) -> Any:
    """Return the class of a reduced model. Errors as for `controller`."""
    return _found(MODELS, name, MODEL_KIND)


def refused(name: str, parts: Mapping[str, Any]) -> str | None:
    """Return the first of the `parts` that is not an argument of the controller's `of`.

    The result is None if all parts are arguments.

    Raises
    ------
    ValueError
        As for `controller`.
    """
    taken = signature(controller(name).of).parameters.values()
    if any(each.kind is Parameter.VAR_KEYWORD for each in taken):
        return None
    return next((part for part in parts if part not in [each.name for each in taken]), None)


def made(name: str, task: ControlTask, **parts: Any) -> Driver:
    """Return a new controller of the given name.

    Parameters
    ----------
    name
        Key of `CONTROLLERS`, or `module:Class`.
    task
        Task of the controller.
    **parts
        Further arguments of `of`, such as `terms` of the cost.

    Raises
    ------
    ValueError
        There is no such controller, its `of` has no argument for one of the parts, or `of` does not return a
        controller.
    """
    from control.guest import Guest  # imports the solvers
    from control.loop import WaveController

    wrong = refused(name, parts)
    if wrong is not None:
        raise ValueError(f"the controller {name!r} has no part {wrong!r}")
    make = controller(name).of
    given = (task,) if "task" in signature(make).parameters else task.fields()
    built = make(*given, **parts)
    if isinstance(built, type) or not isinstance(built, Controller):
        raise ValueError(f"{name}: its of(...) returned {type(built).__name__}, must have reset() and step(t, seen)")
    if not isinstance(built, WaveController):
        return Guest(built, task)
    if len(task.map.held) == task.worm.segments:
        built.held_steering = task.map.held
    return built


def _found(known: Mapping[str, Listed], name: str, kind: named.Kind) -> Any:
    if name in known:
        return getattr(import_module(known[name].module), known[name].name)
    if not named.is_own(name):
        raise ValueError(named.unknown(name, known))
    return named.own(name, kind)
