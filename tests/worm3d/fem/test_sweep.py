"""Paths through a snap-through by two ways, the choice of states, the mesh error, and the table."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.io import netcdf_file

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra 'fem')")

from tests.worm3d.fem.segments import MU, sphere, tube
from worm3d.fem import table
from worm3d.fem.axisymmetric import State, Wall, rest
from worm3d.fem.description import Barrel, Load, Segment
from worm3d.fem.material import Fibres, Yeoh
from worm3d.fem.sweep import (
    FREE_STATES,
    Domain,
    Progress,
    by_arc_length,
    by_steps,
    by_volume,
    domain_of,
    mesh_error,
    on_mesh,
    reached,
    sweep,
)

CORNERS = 4
"""Number of corners of the domain."""
SEGMENT = Segment(
    profile=Barrel(length_m=0.1, plate_radius_m=0.02, middle_radius_m=0.03),
    thickness_m=0.002,
    rubber=Yeoh(c1_Pa=5e4),
    fibres=(Fibres(stiffness_N=5.0, per_m=500.0),),
    load=Load(values=(0.0, 2000.0)),
)


@pytest.fixture(scope="module")
def swept() -> Progress:
    """Return a small sweep."""
    *_, last = sweep(Wall(SEGMENT, 6, 1), 20)
    return last


def balloon_pressure(state: State) -> float:
    """Return the closed form: the integral of 4 dW/dI1 (x^2 - x^-4)/r through the wall, with the hoop stretch x."""
    inner = (state.volume * 3.0 / (4.0 * np.pi)) ** (1.0 / 3.0)
    outer = (inner**3 + 0.0505**3 - 0.0495**3) ** (1.0 / 3.0)

    def integrand(r: float) -> float:
        x = r / (r**3 - inner**3 + 0.0495**3) ** (1.0 / 3.0)
        slope = MU / 2.0 + 3.0 * MU / 500.0 * (2.0 * x**2 + x**-4 - 3.0) ** 2
        return 4.0 * slope * (x**2 - x**-4) / r

    return float(quad(integrand, inner, outer)[0])


def test_a_balloon_snaps_through_on_both_ways() -> None:
    """Yeoh rubber that stiffens has a greatest pressure, beyond which the balloon jumps to a much greater radius."""
    segment = sphere()
    object.__setattr__(segment, "rubber", Yeoh(c1_Pa=MU / 2.0, c3_Pa=MU / 500.0))
    wall = Wall(segment, 4, 1, held="r")
    domain = Domain((0.05, 0.15), (0.0, 4000.0))
    target = 2600.0  # the greatest pressure of the neo-Hookean balloon is 0.62 * 2 MU t/R = 2480 Pa
    direct = by_steps(rest(wall), wall.segment.rest_length, target, domain)
    assert not direct.arrived
    assert 2400.0 < direct.state.input < target
    found = [way(direct.state, wall.segment.rest_length, target) for way in (by_arc_length, by_volume)]
    assert found[0] is not None
    assert found[1] is not None
    assert_allclose(found[0].radius, found[1].radius, rtol=1e-7)
    assert found[0].input == found[1].input == target
    assert_allclose(
        [balloon_pressure(found[0]), balloon_pressure(direct.state)], [target, direct.state.input], rtol=2e-3
    )
    assert found[0].radius > 1.4 * direct.state.radius
    assert found[0].unstable_directions == 0
    whole = reached(rest(wall), wall.segment.rest_length, target, domain)
    assert (whole.arrived, whole.way) == (True, "arc length")


def test_first_states_have_no_force_and_each_further_one_is_far_from_those_before(swept: Progress) -> None:
    assert swept.stable == 20
    assert swept.stopped == ()
    states = swept.states
    assert max(abs(state.force) for state in states[:FREE_STATES]) < 1e-6
    assert (np.diff([state.length for state in states[:FREE_STATES]]) < 0.0).all()
    lengths, inputs = np.array([state.length for state in states]), np.array([state.input for state in states])
    places = domain_of(states[0].wall, states[:FREE_STATES]).spread(lengths, inputs)
    chosen = range(FREE_STATES + CORNERS, len(places))
    gaps = [np.linalg.norm(places[:n] - places[n], axis=1).min() for n in chosen]
    assert all(after <= before * 1.001 for before, after in pairwise(gaps))
    assert min(gaps) > 0.15


def test_a_domain_without_stable_states_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("worm3d.fem.sweep.TRIES_PER_STATE", 1)
    thin = tube(thickness=0.0009, length=0.04, load=Load(values=(0.0, 1.0), length_m=(0.030, 0.034)))
    with pytest.raises(ValueError, match="states are stable, must be 12: the domain of lengths"):
        list(sweep(Wall(thin, 8, 1, held="z"), 12))


def test_a_second_mesh_has_the_state_and_says_the_error(swept: Progress) -> None:
    state = swept.states[-1]
    finer = Wall(SEGMENT, 12, 2)
    found = on_mesh(state, finer)
    assert found is not None
    assert_allclose(found.radius, state.radius, rtol=2e-3)
    assert mesh_error(swept.states, state.wall) < 1e-6
    assert 1e-5 < mesh_error(swept.states, finer) < 0.1


def test_table_has_columns_units_and_attributes(swept: Progress, tmp_path: Path) -> None:
    path = tmp_path / "table.nc"
    table.write(path, SEGMENT, table.columns(swept.states), "a test", 1e-3)
    with netcdf_file(path, mmap=False) as file:
        assert (file.kind, file.version, file.input) == (b"worm3d segment table", 1, b"pressure")
        assert file.rest_length_m == SEGMENT.rest_length
        assert file.variables["force_N"].units == b"N"
        expected = [state.force for state in swept.states]
        assert_allclose(file.variables["force_N"][:], expected)
        pressed = {name for name in table.COLUMNS if name.startswith("pressed")}
        assert set(file.variables) == set(table.COLUMNS) - {"cable_N"} - pressed
