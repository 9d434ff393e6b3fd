"""What cannot be simulated is refused with a sentence: what, what was got, and what is allowed."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import worm3d
from worm3d import ClampedGround, Command, Friction, Held, LimitPointError, Patch, Plane, State, Status, Worm

STRAIGHT = np.column_stack([np.linspace(0.0, 1.0, 7), np.zeros(7), np.full(7, 0.05)])


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"duration": 0.0}, "duration: got 0.0 s, must be finite and above 0"),
        ({"duration": float("nan")}, "duration: got nan s, must be finite and above 0"),
        ({"dt": -0.01}, "dt: got -0.01 s, must be finite and above 0"),
        ({"dt": float("inf")}, "dt: got inf s, must be finite and above 0"),
        ({"dt": 1e-7}, "dt: got 1e-07 s, must be at least 1e-06 s: rounding shows in shorter steps"),
        (
            {"duration": 1e12},
            "duration: got 1e.14 steps of 6 segments, about .* GB of memory, must be at most 4 GB; use a",
        ),
        ({"duration": 1e5, "dt": 1e-3}, "duration: got 1e.08 steps of 6 segments, about 1.38e.03 GB of memory"),
        ({"dt": 5.0}, "dt: got 5 s, must be at most the duration of the run, 0.1 s"),
        ({"duration": None}, "duration: got None s, must be finite and above 0"),
        ({"dt": "0.01"}, "dt: got '0.01' s, must be finite and above 0"),
        (
            {"state": State(joints=STRAIGHT, time=1e12)},
            "state: its time of 1e.12 s is too far from 0 for steps of 0.01 s",
        ),
        ({"record_every": 0}, "record_every: got 0, must be a whole number of at least 1"),
        ({"record_every": 1.5}, "record_every: got 1.5, must be a whole number"),
        ({"record_every": True}, "record_every: got True, must be a whole number"),
        ({"integrator": "rk4"}, "integrator: got 'rk4', must be 'bdf2' or 'implicit_euler'"),
        ({"gravity": 9.81}, "gravity: got 9.81, must be finite, x, y and z"),
        ({"gravity": (0.0, 0.0, float("nan"))}, "gravity: got .*nan.*, must be finite"),
        ({"external_force": lambda t: np.zeros(7)}, r"external_force: got shape \(7,\), must be \(7, 3\): x, y, z"),
        ({"external_force": lambda t: np.full((7, 3), np.inf)}, "external_force: got inf, every value must be finite"),
        ({"actuation": 3.0}, "actuation: got float, must be a gait .* a controller .* or a function of time"),
        ({"actuation": lambda t: None}, "actuation: returned a NoneType, must return a worm3d.Command"),
        (
            {"actuation": lambda t: Command(np.zeros((5, 2)))},
            "returned a command for 5 segments, must be for the worm's 6",
        ),
        ({"sensor": lambda o: o}, "sensor: got an actuation that does not use measurements, must be a controller"),
        ({"ground": Friction(forward=np.ones(5))}, r"forward: got 5 values, must be a number or 6 of them"),
        ({"held": np.zeros((6, 3), dtype=bool)}, r"held.joints: got shape \(6, 3\), must be \(7, 3\)"),
        ({"held": Held(roll=np.zeros(7, dtype=bool))}, r"held.roll: got shape \(7,\), must be \(6,\)"),
        ({"held": Held(bend=np.zeros((6, 2), dtype=bool))}, r"held.bend: got shape \(6, 2\), must be \(6,\)"),
        ({"worm": Worm(chamber_offset=0.0)}, "chamber_offset: got 0 with free bends, must be above 0; or hold"),
        ({"state": State(joints=STRAIGHT[:5])}, "state: got 4 segments, the worm has 6"),
        ({"state": State(joints=STRAIGHT * [1.3, 1, 1])}, "state: the chambers of segment 0 are 0.2167 .* must lie"),
        (
            {"state": State(joints=STRAIGHT - [0, 0, 0.02])},
            "state: segment . lies 0.0.* m inside the world; lift or move",
        ),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_bad_arguments_of_simulate(arguments: dict[str, Any], sentence: str) -> None:
    given = {"worm": Worm(), "world": Plane(), "duration": 0.1} | arguments
    with pytest.raises(ValueError, match=sentence):
        worm3d.simulate(**given)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Friction(forward=-0.1), r"forward: got -0.1, must be finite and in \[0, 1e\+06\]"),
        (lambda: Friction(lateral=float("nan")), "lateral: got nan, must be finite"),
        (lambda: Friction(backward=[0.1, -0.2]), r"backward: got \[0.1, -0.2\], must be finite and in \[0, 1e"),
        (lambda: Friction(static_ratio=0.9), "static_ratio: got 0.9, must be finite and at least 1"),
        (lambda: Plane(slope=1.6), "slope: got 1.6 rad, must be finite and in"),
        (lambda: Plane(slope=float("nan")), "slope: got nan rad"),
        (lambda: Plane(heading=float("inf")), "heading: got inf rad, must be finite"),
        (lambda: Patch(-1.0), "grip: got -1.0, must be finite and at least 0"),
        (lambda: Patch(0.5, along=(1.0, 0.0)), r"along: got \(1.0, 0.0\), must be \(from, to\) with from < to"),
        (lambda: Patch(0.5, across=(np.nan, 1.0)), r"across: got \(nan, 1.0\)"),
        (lambda: ClampedGround(-1e-6), "velocity_threshold: got -1e-06 m/s, must be finite and at least 0"),
        (lambda: State(joints=np.zeros(3)), r"joints: got shape \(3,\), must be \(N\+1, 3\)"),
        (lambda: State(joints=STRAIGHT * np.nan), "joints: got nan, every value must be finite"),
        (lambda: State(joints=STRAIGHT, bend=np.zeros(7)), "bend: got 7 values, must be a number or 6 of them"),
        (
            lambda: State(joints=STRAIGHT, directors=np.zeros((6, 3))),
            "directors: the director of segment 0 is off by 1",
        ),
        (lambda: State(joints=STRAIGHT, directors=np.tile([1.0, 0, 0], (6, 1))), "directors: .* must be a unit vector"),
        (lambda: State(joints=STRAIGHT, time=float("nan")), "time: got nan s, must be finite"),
        (lambda: State(joints=STRAIGHT, roll_rate=np.inf), "roll_rate: got inf, every value must be finite"),
        (lambda: State.straight(Worm(), Plane(), position=(0.0,)), r"position: got \(0.0,\) m"),
        (lambda: State.straight(Worm(), azimuth=float("nan")), "azimuth: got nan rad, must be finite"),
        (lambda: Worm(chamber_offset=0.01, flat=True), "chamber_offset: got 0.01, must be 0 in a worm that is flat"),
        (lambda: Worm(segments=0), "segments: got 0, must be a whole number of at least 1"),
        (
            lambda: Worm(segments=10**8),
            "segments: got 100000000, must be a whole number of at least 1 and at most 1000",
        ),
        (lambda: Worm(mass=1e300), "mass: got 1e.300 kg, must be of a size between 1e-12 and 1e.12"),
        (lambda: Worm(length="1"), "length: got '1' m, must be finite and above 0"),
        (lambda: Worm(end_faces=1), "end_faces: got 1, must be True or False"),
        (lambda: Worm(segments=True), "segments: got True, must be a whole number"),
        (lambda: Worm.planar(k_torsion=-1.0), "k_torsion: .* must be finite and at least 0"),
    ],
)
def test_bad_parts(make: Any, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        make()


def test_states_are_frozen() -> None:
    state = State(joints=STRAIGHT)
    for name in ("joints", "directors", "bend", "joint_velocity", "roll_rate", "bend_rate"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(state, name)[0] = 1.0
    joints = STRAIGHT.copy()
    kept = State(joints=joints)
    joints[0] = 9.0
    assert kept.joints[0, 0] == 0.0


def test_memory_of_another_worm_is_refused() -> None:
    state = worm3d.simulate(Worm(segments=5), Plane(), duration=0.05).state
    longer = State(joints=STRAIGHT, memory=state.memory)
    with pytest.raises(ValueError, match=r"state\.memory: got shape .* it belongs to another worm"):
        worm3d.simulate(Worm(), Plane(), duration=0.05, state=longer)


def test_a_worm_that_is_too_heavy_is_refused_before_the_run() -> None:
    """The sentence says how light it must be: 1 % below that it stands, 1 % above it does not."""
    sentence = r"segment \d would be pressed flat: .* make the worm lighter than \S+ kg"
    with pytest.raises(LimitPointError, match=sentence) as error:
        worm3d.simulate(Worm(mass=1.0), Plane(), duration=0.1)
    lightest = float(str(error.value).split("lighter than ")[1].split(" kg")[0])
    upright = Held(roll=True)
    assert worm3d.simulate(Worm(mass=0.99 * lightest), Plane(), duration=0.1, held=upright).status is Status.DONE
    with pytest.raises(LimitPointError):
        worm3d.simulate(Worm(mass=1.01 * lightest), Plane(), duration=0.1)
    # Without a world, without weight, or clamped nothing presses it.
    for world, gravity in ((None, (0, 0, -9.81)), (Plane(), (0, 0, 0))):
        assert worm3d.simulate(Worm(mass=1.0), world, duration=0.05, gravity=gravity).status is Status.DONE


def test_flattening_weight_is_where_a_loaded_worm_is_pressed_flat() -> None:
    """Two segments, loaded through their joints with 1 % less than the limit point they stand, with 1 % more not."""
    worm = Worm(segments=2, length=0.4, mass=1e-3, end_faces=False, k_torsion=1e3, kelvin_voigt_time=0.2)
    limit, share = worm3d.flattening_weight(worm).sum(), np.array([0.25, 0.5, 0.25])

    def pressed(factor: float) -> Status:
        def force(t: float) -> np.ndarray:
            return np.outer(-factor * limit * share * min(1.0, t / 2.0), [0.0, 0.0, 1.0])

        return worm3d.simulate(worm, Plane(), duration=15.0, dt=0.05, external_force=force).status

    assert pressed(0.99) is Status.DONE
    assert pressed(1.01) is Status.FLATTENED


def pressed_down(t: float) -> np.ndarray:
    """Return 2 N downwards on the joint in the middle, rising over a second."""
    force = np.zeros((7, 3))
    force[3, 2] = -2.0 * min(1.0, t)
    return force


def fold_at_joint_4(t: float) -> worm3d.Command:
    """Return a hinge that closes at joint 4, faster and faster."""
    return worm3d.Command(np.zeros((6, 2)), hinge=np.array([0.0, 0.0, 0.0, 0.8 * t**2, 0.0]))


def lengthen_segment_2(t: float) -> worm3d.Command:
    """Return a contraction that lengthens the right chamber of segment 2 more and more."""
    contraction = np.zeros((6, 2))
    contraction[2, 1] = -0.3 * t
    return worm3d.Command(contraction)


@pytest.mark.parametrize(
    ("worm", "gait", "force", "status", "segment", "reason"),
    [
        (Worm(), fold_at_joint_4, None, Status.FOLDED, 4, "joint 4, between segments 3 and 4, is bent by "),
        (Worm(end_faces=False, k_torsion=0.1), None, pressed_down, Status.SUNK, 3, "joint 3 is 0.0"),
        (Worm(stroke=(-0.5, 0.4)), lengthen_segment_2, None, Status.FLATTENED, 2, "segment 2, whose right chamber is "),
    ],
    ids=["folded", "sunk", "flattened"],
)
def test_guards_say_what_became_of_the_worm(
    worm: Worm, gait: Any, force: Any, status: Status, segment: int, reason: str
) -> None:
    """A shape the model does not stand for ends the run, which says where; what was computed before is kept."""
    run = worm3d.simulate(worm, Plane(), actuation=gait, external_force=force, duration=5.0)
    assert run.status is status
    assert run.status.diverged
    assert np.isfinite(run.joints).all()
    assert run.stop.step == len(run.time) > 10
    assert f"step {run.stop.step}, t = {run.stop.time:.4g} s" in run.stop.sentence
    assert_allclose(run.stop.time, run.stop.step * 0.01)
    assert run.stop.segment == segment
    assert run.stop.reason.startswith(reason)
    assert f"): {reason}" in run.stop.sentence
