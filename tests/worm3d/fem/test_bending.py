"""The 3D quarter model of a bent segment, against beam theory, a closed form, and the axisymmetric model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("skfem")

from worm3d.fem import axisymmetric, bending, description, table
from worm3d.fem.bending import BentState, Condition, QuarterModel, equilibrium

BARREL = """
[profile]
kind = "barrel"
length_m = 0.12
plate_radius_m = 0.02
middle_radius_m = 0.05
[wall]
thickness_m = 0.0015
[rubber]
kind = "Yeoh"
c1_Pa = 50e3
[[fibres]]
stiffness_N = 2.0
per_m = 400.0
[load]
pressure_Pa = [0.0, 4500.0]
"""
CONTRACTED = Condition(0.1, 0.2, 4500.0)


@pytest.fixture(scope="module")
def barrel() -> QuarterModel:
    return QuarterModel(description.parse(BARREL), along=8, around=4)


@pytest.fixture(scope="module")
def bent(barrel: QuarterModel) -> BentState:
    return equilibrium(barrel, CONTRACTED)


def tube(length: float, radius: float = 0.03, thickness: float = 0.0015) -> description.Segment:
    """Return a tube of neo-Hookean rubber, mu = 100 kPa."""
    return description.parse(
        f'[profile]\nkind = "cylinder"\nlength_m = {length}\nradius_m = {radius}\n[wall]\nthickness_m = {thickness}\n'
        '[rubber]\nkind = "neo-Hookean"\nshear_modulus_Pa = 1e5\n[load]\npressure_Pa = [0.0, 4500.0]\n'
    )


def test_a_straight_segment_is_the_axisymmetric_one(barrel: QuarterModel) -> None:
    wall = axisymmetric.Wall(barrel.segment, along=40)
    middle = axisymmetric.solved(axisymmetric.rest(wall), 0.12, 2000.0)
    assert middle is not None
    expected = axisymmetric.solved(middle, 0.11, 4500.0)
    assert expected is not None
    state = equilibrium(barrel, Condition(0.11, 0.0, 4500.0))
    np.testing.assert_allclose(state.force_N, expected.force, atol=0.005 * 15.0)  # 15 N: range of the force
    np.testing.assert_allclose(state.volume_m3, expected.volume, rtol=1e-3)
    np.testing.assert_allclose(state.radius_m, expected.radius, rtol=5e-4)
    np.testing.assert_allclose(barrel.potential(state), expected.potential, rtol=1e-3)
    np.testing.assert_allclose(state.moment_Nm, 0.0, atol=1e-9)
    assert state.stable
    assert expected.unstable_directions == 0


@pytest.mark.parametrize(
    ("place", "step", "measure"), [(0, 1e-5, "force_N"), (1, 1e-4, "moment_Nm"), (2, 2.0, "volume_m3")]
)
def test_force_moment_and_volume_are_slopes_of_the_potential(
    barrel: QuarterModel, bent: BentState, place: int, step: float, measure: str
) -> None:
    change = np.eye(3)[place] * step
    after, before = (
        equilibrium(barrel, Condition(*(np.array(CONTRACTED[:3]) + s * change)), bent) for s in (1.0, -1.0)
    )
    slope = (barrel.potential(after) - barrel.potential(before)) / (2.0 * step)
    np.testing.assert_allclose(getattr(bent, measure) * (-1.0 if place == 2 else 1.0), slope, rtol=1e-5)
    if measure == "moment_Nm":
        rate = (after.moment_Nm - before.moment_Nm) / (2.0 * step)
        np.testing.assert_allclose(bent.bending_stiffness_Nm, rate, rtol=1e-4)


@pytest.mark.slow
def test_bending_of_a_long_tube_is_beam_theory() -> None:
    """The plates stiffen both ends; the difference of two lengths is free of the ends."""
    compliances = []
    for length in (0.3, 0.4):
        state = equilibrium(QuarterModel(tube(length), along=16, around=4), Condition(length, 1e-3, 0.0))
        compliances.append(1e-3 / state.moment_Nm)
        np.testing.assert_allclose(state.bending_stiffness_Nm, state.moment_Nm / 1e-3, rtol=1e-4)
    outer, inner = 0.03 + 0.00075, 0.03 - 0.00075
    EI = 3.0 * 1e5 * np.pi / 4.0 * (outer**4 - inner**4)  # E = 3 mu
    np.testing.assert_allclose((compliances[1] - compliances[0]) * EI, 0.1, rtol=5e-3)


@pytest.mark.parametrize("thickness", [0.0015, 0.008])
def test_a_pressurised_tube_is_the_closed_form_of_a_neo_hookean_cylinder(thickness: float) -> None:
    """p = mu/stretch (ln(a/b) + (a^2 - b^2)/(2 stretch a^2 b^2)), a, b: hoop stretches inside and outside."""
    model = QuarterModel(tube(0.3, 0.03, thickness), along=12, around=4)
    pressure = 0.35 * 1e5 * thickness / 0.03
    points = equilibrium(model, Condition(0.3, 0.0, pressure)).unknowns[: 3 * model.nodes].reshape(-1, 3)
    s, across, turn = model.grid
    inside, outside = (points[(s == 0.0) & (across == side) & (turn == 0.0)][0, 0] for side in (0.0, 1.0))
    a, b = inside / (0.03 - thickness / 2.0), outside / (0.03 + thickness / 2.0)
    second = np.unique(s)[1]
    near = np.flatnonzero((s == second) & (across == 0.0) & (turn == 0.0))[0]
    stretch = points[near, 2] / model.mesh.doflocs[2, near]
    expected = 1e5 / stretch * (np.log(a / b) + (a**2 - b**2) / (2.0 * stretch * a**2 * b**2))
    assert a > 1.1
    np.testing.assert_allclose(pressure, expected, rtol=2e-3)


def test_bending_energy_is_quadratic(barrel: QuarterModel) -> None:
    straight = equilibrium(barrel, CONTRACTED._replace(bend_rad=0.0))
    for bend in (0.1, 0.4):
        state = equilibrium(barrel, CONTRACTED._replace(bend_rad=bend), straight)
        np.testing.assert_allclose(state.moment_Nm, straight.bending_stiffness_Nm * bend, rtol=0.01)
        energy = barrel.potential(state) - barrel.potential(straight)
        np.testing.assert_allclose(energy, straight.bending_stiffness_Nm * bend**2 / 2.0, rtol=0.01)


def test_positive_bend_shortens_the_left_side(barrel: QuarterModel, bent: BentState) -> None:
    outer = barrel.grid[1] == 1.0
    order = np.argsort(barrel.grid[0], kind="stable")
    points = bent.unknowns[: 3 * barrel.nodes].reshape(-1, 3)
    left, right = (
        float(np.linalg.norm(np.diff(points[order[(outer & (barrel.grid[2] == turn))[order]]], axis=0), axis=1).sum())
        for turn in (0.0, 1.0)
    )
    assert left < right
    assert bent.moment_Nm > 0.0
    mirrored = equilibrium(barrel, CONTRACTED._replace(bend_rad=-0.2))
    np.testing.assert_allclose(mirrored.moment_Nm, -bent.moment_Nm, rtol=1e-6)
    np.testing.assert_allclose(mirrored.force_N, bent.force_N, rtol=1e-6)


@pytest.mark.slow
def test_force_and_moment_converge_with_the_mesh() -> None:
    fine, default, coarse = (
        equilibrium(QuarterModel(description.parse(BARREL), along, 3), CONTRACTED) for along in (24, 16, 6)
    )
    errors = np.abs([[s.force_N - fine.force_N, s.moment_Nm - fine.moment_Nm] for s in (default, coarse)])
    assert (errors[0] < errors[1] / 3.0).all()
    assert errors[0, 0] < 0.002 * 15.0
    assert errors[0, 1] < 0.005 * fine.moment_Nm


@pytest.mark.parametrize(("length", "stable"), [(0.098, True), (0.096, False)])
def test_stable_means_a_positive_tangent_on_displacements_that_keep_the_volume(length: float, stable: bool) -> None:
    model = QuarterModel(tube(0.1), along=5, around=3)
    state = equilibrium(model, Condition(length, 0.1, 0.0))
    K = model.derivatives(state.unknowns, 0.0)[1].toarray()
    moves = model.free[model.free < 3 * model.nodes]
    constraint = K[3 * model.nodes :, moves]
    _, sizes, directions = np.linalg.svd(constraint)
    kept = directions[np.sum(sizes > 1e-10 * sizes[0]) :].T
    least = np.linalg.eigvalsh(kept.T @ K[np.ix_(moves, moves)] @ kept)[0]
    assert state.stable == bool(least > 0.0) == stable


def test_rows_of_a_table() -> None:
    segment, said = description.parse(BARREL), []
    states = [(0.11, 0.3, 3000.0), (0.11, 0.1, 1e5), (0.115, 0.1, 3000.0)]
    rows = bending.bent_states(segment, states, along=6, around=3, report=said.append)
    assert [(row["length_m"], row["bend_rad"], row["pressure_Pa"]) for row in rows] == [states[0], states[2]]
    assert all(row["stable"] == 1.0 and row["moment_Nm"] > 0.0 for row in rows)
    assert len(said) == 3
    assert "no equilibrium at length 0.11 m, bend 0.1 rad, pressure 1e+05 Pa; the continuation stopped at" in said[-1]


def test_bends_are_spread_over_straight_states() -> None:
    straight = [(0.125 * i, 1000.0 * i) for i in range(1, 7)]
    assert bending.with_bends(straight, 3) == [(0.125, 0.1, 1000.0), (0.375, 0.2, 3000.0), (0.625, 0.3, 5000.0)]
    assert len(set(bending.with_bends(straight[:3], 12))) == 12


def test_a_cable_adds_its_tension_to_the_force() -> None:
    segment = replace(tube(0.1), load=description.Load(input="cable_N", values=(0.0, 5.0)))
    slack, tight = bending.bent_states(segment, [(0.1, 0.1, 0.0), (0.1, 0.1, 4.0)], along=4, around=3)
    np.testing.assert_allclose(tight["force_N"] - slack["force_N"], 4.0, rtol=1e-6)
    np.testing.assert_allclose(tight["moment_Nm"], slack["moment_Nm"], rtol=1e-6)
    assert tight["cable_N"] == 4.0


@pytest.fixture(scope="module")
def pressed() -> tuple[QuarterModel, list[tuple[float, BentState]]]:
    """Return the barrel, pressed by a flat ground."""
    model = QuarterModel(description.parse(BARREL), along=5, around=5, pressed=True)
    return model, bending.pressed_states(model, [(0.11, 3000.0)])


def test_load_of_the_ground_is_the_slope_of_the_potential_and_the_reaction_of_the_plates(
    pressed: tuple[QuarterModel, list[tuple[float, BentState]]],
) -> None:
    model, ((_, light), *_, (_, state)) = pressed
    ends = [
        equilibrium(model, state.condition._replace(ground_m=state.condition.ground_m + way), state)
        for way in (-1e-5, 1e-5)
    ]
    slope = (model.potential(ends[1]) - model.potential(ends[0])) / 2e-5
    np.testing.assert_allclose(state.load_N, -slope, rtol=1e-4)
    gradient = model.derivatives(state.unknowns, state.condition.pressure_Pa)[0]
    np.testing.assert_allclose(4.0 * gradient[3 * model.rim].sum(), state.load_N, rtol=1e-6)
    assert state.load_N > 5.0 * light.load_N > 0.0
    assert state.stable


@pytest.mark.slow
def test_a_thick_sphere_is_pressed_as_by_hertz() -> None:
    """F = 4/3 E* sqrt(R) d^1.5, E* = 4 mu, has d ~ F^(2/3). The finite thickness adds a term that is linear in F."""
    middle, thickness, length, mu = 0.033, 0.024, 0.04, 1e5
    segment = description.parse(
        f'[profile]\nkind = "barrel"\nlength_m = {length}\nplate_radius_m = {np.sqrt(middle**2 - length**2 / 4.0)}\n'
        f'middle_radius_m = {middle}\n[wall]\nthickness_m = {thickness}\n[rubber]\nkind = "neo-Hookean"\n'
        f"shear_modulus_Pa = {mu}\n[load]\npressure_Pa = [0.0, 1000.0]\n"
    )
    model = QuarterModel(segment, along=6, around=8, across=2, pressed=True)
    rows = table.pressed(bending.pressed_states(model, [(length, 0.0)]))
    way, load = rows["pressed_indentation_m"], rows["pressed_load_N"]
    hertz = (3.0 * load / (16.0 * mu * np.sqrt(middle + thickness / 2.0))) ** (2.0 / 3.0)
    found = np.linalg.lstsq(np.column_stack([hertz, load]) / way[:, None], np.ones(len(way)), rcond=None)[0]
    np.testing.assert_allclose(found[0], 1.0, atol=0.05)
    assert abs(found[1]) * load.max() < 0.2 * way.max()


def test_the_stiffness_of_a_contact_point_is_half_of_the_segment() -> None:
    rows = {"pressed_load_N": np.array([1.0, 2.0, 9.0]), "pressed_indentation_m": np.array([0.01, 0.01, 0.03])}
    assert table.contact_stiffness(rows) == 100.0
    assert table.contact_stiffness({}) is None


def test_a_neighbour_takes_few_iterations(barrel: QuarterModel, bent: BentState) -> None:
    assert equilibrium(barrel, Condition(0.098, 0.25, 4300.0), bent).iterations <= 6


@pytest.mark.parametrize(
    ("states", "message"),
    [
        ([], r"states: got shape"),
        ([(0.1, 0.2)], r"states: got shape"),
        ([(0.0, 0.2, 100.0)], r"length_m: got 0.0, every value must be"),
        ([(0.1, 2.0, 100.0)], r"bend_rad: got 2.0, every value must be"),
        ([(0.1, 0.2, -1.0)], r"pressure_Pa: got -1.0, every value must be"),
    ],
)
def test_states_out_of_range(states: list[tuple[float, ...]], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        bending.bent_states(description.parse(BARREL), states)  # type: ignore[arg-type]
