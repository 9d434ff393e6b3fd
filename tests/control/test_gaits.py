"""Gaits: directions, variants, and how an activation becomes a command."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given, seed
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from control import gaits
from control.gaits import GAITS, Breathing, ContractionEngine_segmentdriven, Gait, TravellingWave, TwoAnchor
from control.gaits.gait import sides
from planar import published
from planar.published import Parameters
from worm3d import Friction, Plane, Worm, simulate


@dataclass(frozen=True)
class Body:
    segments: int = 6
    stroke: tuple[float, float] = (-0.1, 0.45)


def peak_segment(gait: Gait, t: float, segments: int = 60) -> int:
    return int(np.argmax(gait.activation(t, segments)))


def test_direct_wave_runs_to_the_head_and_retrograde_to_the_tail() -> None:
    for direction, sign in (("direct", 1), ("retrograde", -1)):
        wave = TravellingWave(period=2.0, direction=direction)
        # An eighth of a period later the crest has moved an eighth of a wavelength, 7.5 of 60 segments.
        moved = peak_segment(wave, 0.75) - peak_segment(wave, 0.5)
        assert (moved - sign * 7.5) % 60 == pytest.approx(0.0, abs=1.01) or (
            (moved - sign * 7.5) % 60 == pytest.approx(60.0, abs=1.01)
        )


def test_direct_wave_is_the_papers_formula() -> None:
    x = (np.arange(6) + 0.5) / 6
    wave = TravellingWave(period=3.0, wavelength=0.8, direction="direct", rectified=False)
    assert_allclose(wave.activation(0.7, 6), np.sin(2 * np.pi * (x / 0.8 - 0.7 / 3.0)), atol=1e-14)


def test_direct_rectified_wave_is_the_published_programs_own() -> None:
    wave = TravellingWave(period=2.0, direction="direct")
    own = published.travelling_wave(6, 2.0, Parameters())
    for t in np.linspace(0.0, 4.0, 41):
        assert_allclose(wave.activation(t, 6), own(t), atol=1e-14)


def test_standing_wave_has_fixed_nodes_and_is_the_mean_of_both_travelling_ones() -> None:
    both = [TravellingWave(direction=d, rectified=False) for d in ("direct", "retrograde")]
    standing = TravellingWave(direction="standing", rectified=False)
    for t in np.linspace(0.0, 2.0, 17):
        mean = (both[0].activation(t, 7) + both[1].activation(t, 7)) / 2
        assert_allclose(standing.activation(t, 7), mean, atol=1e-14)
        assert_allclose(standing.activation(t, 7)[3], 0.0, atol=1e-14)


@seed(1)
@given(
    t=st.floats(0, 100),
    segments=st.integers(1, 40),
    direction=st.sampled_from(["direct", "retrograde", "standing"]),
)
def test_rectified_wave_is_the_positive_part_of_the_full_one(t: float, segments: int, direction) -> None:
    full = TravellingWave(direction=direction, rectified=False).activation(t, segments)
    rectified = TravellingWave(direction=direction).activation(t, segments)
    assert_array_equal(rectified, np.maximum(full, 0.0))
    assert np.abs(full).max() <= 1.0


def test_bias_shortens_the_left_chambers_more_and_is_clipped_to_the_stroke() -> None:
    wave = TravellingWave(amplitude=0.3, bias=0.8)
    command = wave.bind(Body())(0.4)
    activation = wave.activation(0.4, 6)
    assert_allclose(command.contraction[:, 0], np.minimum(0.3 * 1.8 * activation, 0.45))
    assert_allclose(command.contraction[:, 1], 0.3 * 0.2 * activation)
    assert command.contraction.max() == 0.45
    full = TravellingWave(amplitude=0.3, rectified=False).bind(Body())(0.4)
    assert full.contraction.min() == -0.1


def test_hinges_belong_to_their_headward_segment_and_follow_its_contraction() -> None:
    wave = TravellingWave(hinge=2.0, rectified=False)
    command = wave.bind(Body())(0.3)
    assert_allclose(command.hinge, 2.0 * np.maximum(0.0, wave.activation(0.3, 6)[1:]))
    assert command.hinge.max() > 1.0


def test_force_is_applied_to_both_chambers() -> None:
    command = TravellingWave(amplitude=0.0, force=3.0, bias=0.25).bind(Body())(0.4)
    assert_array_equal(command.contraction, np.zeros((6, 2)))
    assert_allclose(command.force, 3.0 * TravellingWave().activation(0.4, 6)[:, None] * [1.25, 0.75])


def test_defaults_are_those_of_the_notation() -> None:
    wave = TravellingWave()
    assert (wave.period, wave.wavelength, wave.amplitude, wave.direction) == (2.0, 1.0, 0.2, "retrograde")
    assert wave.rectified
    assert (wave.bias, wave.hinge, wave.force) == (0.0, 0.0, 0.0)


def test_the_default_engine_contracts_one_segment_at_a_time() -> None:
    engine = ContractionEngine_segmentdriven(contractType="square")
    active = [len(np.flatnonzero(engine.activation(t, 6))) for t in np.arange(0.0, 4.0, 0.01)]
    assert max(active) == 1


def test_activation_instants_are_not_lost_to_rounding() -> None:
    """Every segment fires once a wave in a sampled run, whatever n and the step."""
    for n in (3, 5, 7):
        engine = ContractionEngine_segmentdriven(contractType="dirac", alternating=False, impulse=0.01)
        sampled = np.array([engine.activation(0.01 * k, n) for k in range(1000)])
        assert_array_equal(sampled.sum(axis=0), np.full(n, 5.0))


def active_segments(engine: ContractionEngine_segmentdriven, t: float) -> list[int]:
    return np.flatnonzero(engine.activation(t, 4)).tolist()


def test_engine_activates_one_segment_after_the_other() -> None:
    engine = ContractionEngine_segmentdriven(T_wave=2.0, T_contract=0.5, contractType="square")
    instants = [0.0, 0.49, 0.5, 0.99, 1.0, 1.5, 1.99, 2.0, 2.5]
    assert [active_segments(engine, t) for t in instants] == [[0], [0], [1], [1], [2], [3], [3], [0], [1]]
    back = ContractionEngine_segmentdriven(T_contract=0.5, contractType="square", direction="retrograde")
    assert [active_segments(back, t) for t in (0.0, 0.5, 1.0, 1.5, 2.0)] == [[3], [2], [1], [0], [3]]


def test_engine_resets_after_the_contraction_and_overlaps_when_it_is_long() -> None:
    short = ContractionEngine_segmentdriven(T_wave=2.0, T_contract=0.2, contractType="square")
    assert active_segments(short, 0.3) == []
    long = ContractionEngine_segmentdriven(T_wave=2.0, T_contract=0.9, contractType="square")
    assert active_segments(long, 0.6) == [0, 1]
    assert active_segments(long, 0.1) == [0], "before the first wave has reached it, no segment is active"
    assert active_segments(long, 2.1) == [0, 3]


def test_engine_signs_alternate() -> None:
    engine = ContractionEngine_segmentdriven(T_contract=2.0, contractType="square")
    assert_array_equal(engine.activation(1.9, 4), [1.0, -1.0, 1.0, -1.0])
    same = ContractionEngine_segmentdriven(T_contract=2.0, contractType="square", alternating=False)
    assert_array_equal(same.activation(1.9, 4), np.ones(4))


def test_pulses() -> None:
    gaussian = ContractionEngine_segmentdriven(T_contract=0.4, contractType="gaussian")
    values = [gaussian.activation(t, 4)[0] for t in (0.1, 0.2, 0.3)]
    assert_allclose(values, [np.exp(-0.5 * (0.25 / 0.15) ** 2), 1.0, values[0]], rtol=1e-6)
    dirac = ContractionEngine_segmentdriven(contractType="dirac", impulse=0.01)
    sampled = np.array([dirac.activation(0.01 * k, 4) for k in range(400)])
    assert_array_equal(np.abs(sampled).sum(axis=0), [2.0, 2.0, 2.0, 2.0])


@pytest.mark.parametrize(
    ("build", "sentence"),
    [
        (lambda: TravellingWave(period=0.0), "period: got 0.0 s, must be finite and above 0"),
        (lambda: TravellingWave(direction="sideways"), "direction: got 'sideways', must be one of 'direct'"),
        (lambda: TravellingWave(wavelength=-1.0), "wavelength: got -1.0 body lengths, must be finite and above 0"),
        (lambda: TravellingWave(bias=1.5), r"bias: got 1.5, must be a number in \[-1, 1\]"),
        (lambda: TravellingWave(bias=-1.5), r"bias: got -1.5, must be a number in \[-1, 1\]"),
        (lambda: TravellingWave(amplitude=float("nan")), "amplitude: got nan, must be finite"),
        (
            lambda: ContractionEngine_segmentdriven(T_wave=1.0, T_contract=1.5),
            r"T_contract: got 1.5 s, must be at most T_wave \(1.0 s\)",
        ),
        (lambda: ContractionEngine_segmentdriven(contractType="sine"), "contractType: got 'sine'"),
    ],
)
def test_bad_gaits(build, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        build()


def test_gaits_are_found_by_name() -> None:
    named = {
        "travelling_wave": TravellingWave,
        "segment_driven": ContractionEngine_segmentdriven,
        "two_anchor": TwoAnchor,
    }
    assert named.items() <= GAITS.items()
    assert all(gait.name == name for name, gait in GAITS.items())
    with pytest.raises(ValueError, match="name: got 'two_anchor', must be another than those of the gaits"):

        class Again(TwoAnchor, name="two_anchor"):
            pass

    assert GAITS["two_anchor"] is TwoAnchor


@pytest.mark.parametrize(
    "gait",
    [
        *(gait() for gait in GAITS.values() if not getattr(gait(), "senses", ())),
        *(TravellingWave(rectified=False, direction=way) for way in ("direct", "retrograde", "standing")),
        ContractionEngine_segmentdriven(alternating=False),
        TwoAnchor(extension=0.0),
    ],
)
def test_a_gait_says_whether_it_lengthens(gait: Gait) -> None:
    sampled = gait.activations(np.linspace(0.0, 12.0, 2401), 7)
    assert gait.lengthens == (sampled.min() < 0.0)
    assert np.abs(sampled).max() <= 1.0
    assert_array_equal(sides(sampled)[100].mean(axis=-1), gait.activation(0.5, 7))


def test_breathing_contracts_all_segments_for_its_share_of_the_period() -> None:
    gait = Breathing(period=2.0, contracting=0.25)
    assert_allclose(
        gait.activations(np.array([0.0, 0.25, 0.5, 1.25, 2.0]), 3)[:, 1], [0.0, 0.5, 1.0, 0.5, 0.0], atol=1e-15
    )
    assert_array_equal(gait.activation(0.3, 5), np.full(5, gait.activation(0.3, 1)))


@pytest.mark.parametrize(("forward", "backward"), [(0.1, 0.3), (0.3, 0.1), (0.2, 0.2)])
def test_breathing_crawls_as_far_as_its_closed_form_says(forward: float, backward: float) -> None:
    worm, period, contraction = Worm(end_faces=False, actuator_lag=0.02), 4.0, 0.15
    friction = Friction(forward=forward, backward=backward, static_ratio=1.0)
    gait = Breathing(period=period, amplitude=contraction)
    run = simulate(worm, Plane(), friction, actuation=gait, duration=2.0 * period)
    x = run.com[[round(period / 0.01), -1], 0]
    # Its neutral places, three quarters from an end, are those of feet, so that six segments move as a continuum does.
    expected = contraction * worm.length * (backward - forward) / (backward + forward)
    assert x[1] - x[0] == pytest.approx(expected, abs=0.01 * contraction * worm.length)


def test_a_gait_that_is_defined_again_takes_the_place_of_the_former_one() -> None:
    def define(qualname: str) -> type:
        return type("Mine", (Gait,), {"__qualname__": qualname, "__module__": __name__}, name="defined_again")

    try:
        define("Mine")
        again = define("Mine")
        assert GAITS["defined_again"] is again
        with pytest.raises(ValueError, match="name: got 'defined_again', must be another than those of the gaits"):
            define("Other")
    finally:
        GAITS.pop("defined_again", None)


@pytest.mark.parametrize(
    ("gait", "told"),
    [
        (gaits.Periodic(phase=[0.0, 0.5]), r"phase: got shape \(2,\)"),
        (gaits.Inchworm(anchors=4), "anchors: got 4, must leave a segment"),
        (gaits.SHC(nu=[2.0, 3.0]), "nu: got 2 values, must be a number or 6 of them"),
        (gaits.SHC(nodes=2), "nodes: got 2, must be at least 3"),
        (gaits.Reflexive(gaits.Inchworm(anchors=4), (gaits.WallLoad(),)), "anchors: got 4, must leave a segment"),
    ],
)
def test_a_gait_that_does_not_suit_the_worm_is_refused_before_the_run(gait: Any, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        simulate(Worm(), Plane(), actuation=gait, duration=1.0)


def test_reflexes_come_in_a_tuple() -> None:
    alone: Any = gaits.WallLoad()
    with pytest.raises(ValueError, match=r"reflexes: got WallLoad, must be several in a tuple, such as \(WallLoad"):
        gaits.Reflexive(TravellingWave(), alone)
