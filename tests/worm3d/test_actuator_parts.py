"""An actuator is one class: states of its own, for chambers and hinges, compiled with the plant and gone on with."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from control.gaits import TravellingWave
from worm3d import Actuator, Command, FirstOrder, Plane, Response, Worm
from worm3d.values.parameters import parameter

STILL = Command([[0.2, 0.1], [0.0, -0.05], [0.15, 0.15]], hinge=[0.2, -0.1])


@dataclass(frozen=True, eq=False, kw_only=True)
class Swinging(Actuator):
    """Critically damped response of second order, solved exactly for a command that is constant in the step."""

    states: ClassVar[Mapping[str, str]] = {"speed": "1/s"}
    rate: Any = parameter(10.0, meaning="natural frequency", unit="1/s", gt=0, each="segment")

    @classmethod
    def respond(cls, s: Mapping[str, Any]) -> Response:
        away, speed, w, dt = s["given_n"] - s["command"], s["speed_n"], s["rate"], s["dt"]
        drift, decay = speed + w * away, ca.exp(-w * dt)
        return Response(
            command=s["command"],
            given=s["command"] + (away + drift * dt) * decay,
            states={"speed": (speed - w * drift * dt) * decay},
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Spring(Actuator):
    """A further spring along each chamber, with a stiffness in N/m: a potential and energy, no states."""

    stiffness: Any = parameter(30.0, meaning="stiffness", unit="N/m", ge=0, each="segment")
    drives_hinges: ClassVar[bool] = False

    @classmethod
    def respond(cls, s: Mapping[str, Any]) -> Response:
        energy, energy_n = (s["stiffness"] / 2.0 * (s[name] - s["l0"]) ** 2 for name in ("length", "length_n"))
        return Response(command=s["command"], given=s["command"], potential=energy, stored=energy - energy_n)


def floating(worm: Worm, duration: float = 1.0, **more: Any) -> worm3d.Result:
    return worm3d.simulate(worm, None, actuation=lambda t: STILL, duration=duration, gravity=(0, 0, 0), **more)


def body(**more: Any) -> Worm:
    return Worm(**{"segments": 3, "length": 0.5, **more})


@pytest.mark.parametrize("rate", [10.0, np.array([5.0, 10.0, 20.0])])
def test_a_state_of_ones_own_answers_by_its_closed_form(rate: Any) -> None:
    """c(t) = c0 (1 - (1 + w t) exp(-w t)) and c' = c0 w^2 t exp(-w t), for chambers and for hinges."""
    run = floating(body(actuator=Swinging(rate=rate), hinge_actuator=Swinging(rate=4.0)))
    w, t = np.broadcast_to(rate, 3)[None, :, None], run.time[:, None, None]
    assert_allclose(run.contraction, STILL.contraction * (1.0 - (1.0 + w * t) * np.exp(-w * t)), rtol=0, atol=1e-14)
    assert_allclose(run.actuator_states["speed"], STILL.contraction * w**2 * t * np.exp(-w * t), rtol=0, atol=1e-13)
    t = run.time[:, None]
    assert_allclose(run.hinge, STILL.hinge * (1.0 - (1.0 + 4.0 * t) * np.exp(-4.0 * t)), rtol=0, atol=1e-14)
    assert_allclose(run.actuator_states["hinge_speed"], STILL.hinge * 16.0 * t * np.exp(-4.0 * t), rtol=0, atol=1e-13)
    assert run.energy.balance_error < 2e-13


def test_a_run_goes_on_with_the_states_bit_for_bit() -> None:
    worm = body(actuator=Swinging(), hinge_actuator=Swinging(rate=4.0))
    whole, begun = floating(worm, 0.6), floating(worm, 0.3)
    rest = floating(worm, 0.3, state=begun.state)
    for name in ("joints", "contraction", "hinge"):
        assert_array_equal(getattr(rest, name)[1:], getattr(whole, name)[31:])
    for name, states in whole.actuator_states.items():
        assert_array_equal(rest.actuator_states[name], states[30:])


def test_a_batch_is_as_single_runs() -> None:
    worm = body(actuator=Swinging())
    batch = worm3d.simulate_batch(
        [worm, body()], None, actuation=lambda t: STILL, duration=0.2, gravity=(0, 0, 0), threads=2
    )
    assert_array_equal(batch[0].joints, floating(worm, 0.2).joints)
    assert_array_equal(batch[1].joints, floating(body(), 0.2).joints)


def test_a_batch_takes_a_class_that_was_made_in_a_function() -> None:
    class Own(Swinging):
        pass

    worm = body(actuator=Own())
    batch = worm3d.simulate_batch([worm, worm], None, actuation=lambda t: STILL, duration=0.1, gravity=(0, 0, 0))
    assert_array_equal(batch[1].joints, floating(body(actuator=Swinging()), 0.1).joints)


def test_a_potential_is_a_spring_beside_the_chambers_own() -> None:
    """A stiffness that doubles the chamber's own halves what a pull of its ends does; its energy is in the ledger."""
    worm = Worm(segments=1, length=0.2)
    own = worm.k_spring[0] / (2.0 * worm.l0)  # type: ignore[index]
    pull = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    runs = [
        worm3d.simulate(
            Worm(segments=1, length=0.2, **more), None, external_force=lambda t: pull, duration=4.0, gravity=(0, 0, 0)
        )
        for more in ({}, {"actuator": Spring(stiffness=own)})
    ]
    stretched = [run.chamber_length[-1] - worm.l0 for run in runs]
    assert_allclose(stretched[1], stretched[0] / 2.0, rtol=1e-8)
    stored = 2.0 * own / 2.0 * stretched[1][0, 0] ** 2
    assert_allclose(runs[1].energy.actuator.sum(), stored, rtol=1e-8)
    assert runs[1].energy.balance_error < 1e-12


def test_the_default_is_the_worms_own_lag_stroke_and_rate() -> None:
    worm = Worm(actuator_lag=0.05, stroke=(0.0, 0.15), rate_limit=0.5)
    own = FirstOrder(lag=np.full(6, 0.05), least=0.0, greatest=0.15, rate_limit=0.5)
    other = Worm(actuator=own, hinge_actuator=FirstOrder(lag=0.05))
    runs = [
        worm3d.simulate(each, Plane(), actuation=TravellingWave(amplitude=0.15, bias=0.2, hinge=0.3), duration=1.0)
        for each in (worm, other)
    ]
    assert_array_equal(runs[0].joints, runs[1].joints)
    assert_array_equal(runs[0].command, runs[1].command)


def test_each_segment_may_have_its_own_lag() -> None:
    lag = np.array([0.0, 0.1, 0.4])
    run = floating(body(actuator=FirstOrder(lag=lag), hinge_actuator=FirstOrder(lag=[0.05, 0.2])))
    t = run.time[1:, None]
    with np.errstate(divide="ignore"):
        assert_allclose(run.contraction[1:, :, 0], STILL.contraction[:, 0] * (1.0 - np.exp(-t / lag)), atol=1e-14)
    assert_allclose(run.hinge[1:], STILL.hinge * (1.0 - np.exp(-t / [0.05, 0.2])), atol=1e-14)


class _Curious(Actuator):
    """It asks for what no actuator knows."""

    @classmethod
    def respond(cls, s: Mapping[str, Any]) -> Response:
        return Response(command=s["command"], given=s["voltage"])


class _Forgetful(Actuator):
    """It has a state, and does not say what becomes of it."""

    states: ClassVar[Mapping[str, str]] = {"charge": "C"}

    @classmethod
    def respond(cls, s: Mapping[str, Any]) -> Response:
        return Response(command=s["command"], given=s["command"])


class _Late(Actuator):
    """Its contraction would depend on the unknown length."""

    @classmethod
    def respond(cls, s: Mapping[str, Any]) -> Response:
        return Response(command=s["command"], given=s["command"] * s["length"] / s["l0"])


@dataclass(frozen=True, eq=False, kw_only=True)
class _Broad(Actuator):
    @classmethod
    def respond(cls, s: Mapping[str, Any]) -> Response:
        return Response(command=s["command"], given=ca.vertcat(s["command"], s["command"]))


@dataclass(frozen=True, eq=False, kw_only=True)
class _Restless(Actuator):
    states: ClassVar[Mapping[str, str]] = {"speed": "1/s"}

    @classmethod
    def respond(cls, s: Mapping[str, Any]) -> Response:
        return Response(command=s["command"], given=s["command"], states={"speed": s["speed_hat"]})

    @classmethod
    def at_rest(cls, s: Mapping[str, Any]) -> Mapping[str, Any]:
        return {}


@dataclass(frozen=True, eq=False, kw_only=True)
class _Taken(Actuator):
    dt: float = parameter(0.1, meaning="a name that `respond` finds already")


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Worm(actuator=0.1), r"actuator: got float, must be a worm3d.Actuator"),
        (lambda: Worm(actuator=FirstOrder(lag=np.ones(5))), r"actuator.lag: got 5 values, must be a number or 6"),
        (lambda: Worm(hinge_actuator=FirstOrder(lag=np.ones(6))), r"hinge_actuator.lag: got 6 values, .* or 5 of them"),
        (lambda: FirstOrder(lag=-1.0), r"lag: got -1.0, must be"),
        (lambda: Worm(hinge_actuator=Spring()), r"hinge_actuator: got Spring, which acts on chambers alone"),
        (
            lambda: floating(body(actuator=_Late())),
            r"actuator: its given \(also used as its spring\) must not depend on length, span or ..._hat. Use dt",
        ),
        (
            lambda: floating(body(actuator=_Curious())),
            r"_Curious.respond: 'voltage' is not an input; the inputs are command, ",
        ),
        (
            lambda: floating(body(actuator=_Forgetful())),
            r"_Forgetful.respond: got \[\], must be the states \['charge'\]",
        ),
        (
            lambda: floating(body(actuator=Actuator())),
            r"Actuator.respond: the method is missing, must be defined; the inputs are",
        ),
        (lambda: floating(body(actuator=_Broad())), r"_Broad.respond, given: got an array of shape \(2, 1\), must be"),
        (lambda: floating(body(actuator=_Restless())), r"_Restless.at_rest: got \[\], must be the states \['speed'\]"),
        (_Taken, r"_Taken: the names dt are taken; rename the parameter"),
    ],
)
def test_what_is_wrong_is_said(make: Any, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        make()


@pytest.mark.parametrize(
    ("respond", "sentence"),
    [
        (lambda s: None, r"respond: got NoneType, must be a Response with the states \[\]"),
        (lambda: None, r"respond: got TypeError: .*; must be a scalar expression"),
        (lambda s: Response(s["command"], None), r"respond, given: got NoneType, must be a scalar expression"),
        (lambda s: Response(s["command"], "0.3"), r"respond, given: got str, must be"),
        (lambda s: Response(s["command"]), r"respond: got TypeError: .*'given'; must be"),
        (lambda s: Response(s["command"], s["command"], states=None), r"respond: got NoneType, must be the states"),
        (
            lambda s: Response(s["command"], s["command"] if s["command"] > 0 else 0.0),
            r"respond: got a decision of Python on an expression, .*; must be .* ca.if_else, ca.fmin and ca.fmax",
        ),
        (lambda s: Response(s["command"], max(s["command"], 0.0)), r"respond: got a decision of Python"),
        (
            lambda s: Response(s["command"], ca.if_else(s["command"] > 0, None, 0.0)),
            r"respond: got NotImplementedError: Wrong number or type of arguments .*'if_else'.; must be",
        ),
    ],
)
def test_an_answer_that_is_no_expression_is_said(respond: Any, sentence: str) -> None:
    own = type("Own", (Actuator,), {"respond": staticmethod(respond)})
    with pytest.raises(ValueError, match="Own." + sentence):
        floating(body(actuator=own()))


def test_states_at_rest_that_are_none_are_said() -> None:
    own = type("Own", (Swinging,), {"at_rest": staticmethod(lambda s: None)})
    with pytest.raises(ValueError, match=r"Own.at_rest: got NoneType, must be the states \['speed'\]"):
        floating(body(actuator=own()))


def test_what_sensors_see_is_what_is_recorded() -> None:
    seen: list[worm3d.Observation] = []

    def look(t: float, view: worm3d.View) -> None:
        seen.append(view.observation())

    worm = body(actuator=Swinging(rate=8.0), hinge_actuator=Swinging(rate=4.0))
    gait = TravellingWave(amplitude=0.3, bias=0.3, hinge=0.5, direction="direct")
    run = worm3d.simulate(worm, Plane(), actuation=gait, duration=0.3, observer=look, every=1)
    arrays = (
        "com",
        "com_velocity",
        "joints",
        "joint_velocity",
        "apexes",
        "chamber_strain",
        "contraction",
        "normal_load",
    )
    for name in arrays:
        assert_array_equal([getattr(each, name) for each in seen], getattr(run, name), err_msg=name)
    assert set(run.actuator_states) == {"speed", "hinge_speed"}
    for name, values in run.actuator_states.items():
        assert_array_equal([each.actuator_states[name] for each in seen], values, err_msg=name)
        assert np.ptp(values) > 0.1


def _failing(part: str, late: bool = True) -> type[Actuator]:
    """Return an actuator whose command, given contraction, state or energy is not a number from a command of 0.3 on."""

    def respond(s: Mapping[str, Any]) -> Response:
        wrong = ca.if_else(s["command"] > 0.3, np.nan, 0.0) if late else np.nan
        sound = Response(s["command"], s["command"], states={"charge": s["command"]})
        if part == "charge":
            return sound._replace(states={"charge": wrong})
        name = "stored" if part == "energy" else part
        return sound._replace(
            **{name: getattr(sound, name) + wrong, "spring": s["command"]}
            if part == "given"
            else {name: getattr(sound, name) + wrong}
        )

    return type("Failing", (Actuator,), {"respond": staticmethod(respond), "states": {"charge": "C"}})


@pytest.mark.parametrize("part", ["command", "given", "force", "charge", "energy"])
def test_what_becomes_not_a_number_ends_the_run_at_that_step(part: str) -> None:
    def rise(t: float) -> Command:
        return Command([[0.0, 0.0], [0.0, 10.0 * t], [0.0, 0.0]])

    run = worm3d.simulate(
        body(actuator=_failing(part)()), None, actuation=rise, duration=0.1, dt=0.01, gravity=(0, 0, 0)
    )
    assert run.status is worm3d.Status.NOT_FINITE
    assert (run.stop.step, run.stop.segment, len(run.time)) == (4, 1, 4)
    where = "segment 1" if part == "energy" else "the right chamber of segment 1"
    assert run.stop.reason == f"actuator: Failing gives no finite {part} for {where}"
    for values in (
        run.joints,
        run.contraction,
        run.actuator_states["charge"],
        run.energy.actuator,
        run.energy.work_contract,
    ):
        assert np.isfinite(values).all()


def test_a_hinge_that_becomes_not_a_number_ends_the_run() -> None:
    def rise(t: float) -> Command:
        return Command(np.zeros((3, 2)), hinge=[0.0, 10.0 * t])

    run = worm3d.simulate(
        body(hinge_actuator=_failing("charge")()), None, actuation=rise, duration=0.1, dt=0.01, gravity=(0, 0, 0)
    )
    assert (run.status, run.stop.step, len(run.time)) == (worm3d.Status.NOT_FINITE, 4, 4)
    assert run.stop.reason == "hinge_actuator: Failing gives no finite charge for joint 2"


def test_what_is_not_a_number_while_settling_names_the_actuator() -> None:
    worm = body(actuator=_failing("given", late=False)())
    run = worm3d.simulate(worm, Plane(), duration=0.1)
    assert (run.status, len(run.time)) == (worm3d.Status.NOT_FINITE, 1)
    assert run.stop.reason == "actuator: Failing gives no finite given for the left chamber of segment 0"
    batch = worm3d.simulate_batch([worm, body()], Plane(), duration=0.1)
    assert [each.status for each in batch] == [worm3d.Status.NOT_FINITE, worm3d.Status.DONE]
