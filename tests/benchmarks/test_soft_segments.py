"""Splines and chain of the benchmark of soft segments: against SciPy, the shipped law, and closed forms."""

import casadi as ca
import numpy as np
import soft_tables
from interpolated_law import GRIDS, Bent, Interpolated, Points, bending, of_learned
from numpy.testing import assert_allclose
from scipy.io import netcdf_file
from soft_chain import Answer, Elastic, Ground, OfLaw, Stand, Support, walk

from scenes.studies.fem.command import DATA
from worm3d import Learned, Worm
from worm3d.physics.segment_laws.law import SEGMENT_LAWS, columns_of
from worm3d.values.arrays import FloatArray

SEGMENT_LAWS.pop("interpolated", None)  # other tests look at the laws that ship


def test_symbolic_splines_are_those_of_scipy() -> None:
    """Values and first derivatives, which the kernels and the least squares use."""
    at = ca.SX.sym("at")
    for axis in (axis for grid in GRIDS.values() for axis in grid):
        basis = axis.symbols(at)
        function = ca.Function("basis", [at], [basis, ca.jacobian(basis, at)])
        points = np.linspace(axis.low, axis.high, 41)
        values, slopes = (each.full() for each in function(points[None]))
        assert_allclose(values.T, axis.matrix(points), atol=1e-12)
        assert_allclose(slopes.T, axis.matrix(points, 1), atol=1e-9)


def test_splines_follow_the_shipped_law() -> None:
    """The force of the projected law and the force of the law itself, within 0.03 N (rms), and the radius."""
    learned = Learned("barrel.json")
    law, splines = learned.law, of_learned(learned)
    length, entry = (each.ravel() for each in np.meshgrid(np.linspace(0.67, 1.02, 15) * law.rest_length, range(41)))
    points = Points(law, length, law.contraction[entry])
    at = np.linspace(0.0, law.most_contraction, len(law.shortest))
    low, high = (np.interp(law.contraction[entry], at, bound) for bound in (law.shortest, law.longest))
    inside = (length > low) & (length < high) & (points.strain[0] > -0.06) & (points.strain[0] < 0.09)
    exact = OfLaw(learned).at(length[inside], law.value[entry[inside]])
    miss = points.force(splines["energy"])[inside] - exact.force
    assert np.sqrt(np.mean(miss**2)) < 0.03  # most of the difference is near the rest length without pressure
    assert_allclose(points.value("radius", splines["radius"])[inside], exact.radius, atol=5e-5)


def test_bent_segments_of_kernels_and_of_least_squares_agree() -> None:
    """Force and moment are derivatives of the energy in the kernels, with and without w; then S_K is found again."""
    learned = Learned("barrel.json")
    law, splines = learned.law, of_learned(learned)
    rng = np.random.default_rng(0)
    bend, contraction = rng.uniform(0.1, 0.4, 200), rng.uniform(0.0, 0.25, 200)
    length = law.rest_length * (1.0 - contraction) * (1.0 - rng.uniform(-0.05, 0.05, 200))
    states = Bent(length, contraction, bend, 0.0 * bend, 0.0 * bend)
    for whole, offset in ((1.0, 0.0), (0.0, law.chamber_offset)):
        exact = _answer(Interpolated("barrel.json", splines=splines, whole=whole), length, contraction, bend)
        for one, other in zip(exact, states.answer(law, splines, offset), strict=True):
            assert_allclose(one, other, atol=1e-8)
        if whole:
            found = bending(law, splines["energy"], Bent(length, contraction, bend, *exact))
            moment = states.answer(law, splines | found, offset)[1]
            assert_allclose(moment, exact[1], atol=0.01 * np.abs(exact[1]).max())


def _answer(
    segment: Interpolated, length: FloatArray, contraction: FloatArray, bend: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return force and moment from the energies in CasADi symbols."""
    law, worm = segment.law, Worm(segment=segment)
    known = {name: ca.DM(each[:, :1]) for name, each in columns_of(segment, worm).items()}
    at = axis, a, th = [ca.SX.sym("x") for _ in range(3)]
    commanded = law.rest_length * (1.0 - a)
    (spring,) = segment.springs(known)
    sides = sum(spring.energy(axis + sign * law.chamber_offset * th, commanded) for sign in (1.0, -1.0))
    energy = sides + segment.bending(known, axis, th, ca.vertcat(commanded, commanded))
    both = ca.Function("both", at, [ca.gradient(energy, axis), ca.gradient(energy, th)])
    force, moment = (each.full()[0] for each in both(length[None], contraction[None], bend[None]))
    return force, moment


class Springs:
    """Linear springs that become shorter by 1 mm for each pascal."""

    def at(self, length: FloatArray, pressure: FloatArray) -> Answer:
        one = np.ones(len(length))
        return Answer(1e3 * (length - 0.1 + 1e-3 * pressure), 1e3 * one, 0.05 * one, 0.0 * one)


class Given:
    """Given loads of segments without slopes."""

    def __init__(self, *load: float) -> None:
        self.support = Support(np.array(load), np.zeros((len(load),) * 2), np.zeros(len(load)))

    def at(self, height: FloatArray, length: FloatArray, pressure: FloatArray) -> Support:
        return self.support


def test_inchworm_walks_by_its_stroke_less_the_stretch_of_friction() -> None:
    """Of three springs, the middle one works. The tail slides while it shortens, the head while it lengthens.

    Friction of the tail stretches the middle spring by f/k, f = mu_f load, and half of each end spring by f/(4 k) while
    it shortens. Friction of the head presses them together by as much while it lengthens. The stroke of 10 mm loses
    both.
    """
    cycles = np.tile([[0.0, 10.0, 0.0], [0.0, 0.0, 0.0]], (3, 1))
    found = walk(Springs(), np.linspace(0.0, 0.3, 4), cycles, Ground(0.05, 0.4, 0.03, Given(2.0, 0.0, 2.0)))
    stretch = 0.05 * 2.0 / 1e3
    assert_allclose(found.force, np.tile([[0.05, 0.1, 0.05], [-0.05, -0.1, -0.05]], (3, 1)), atol=1e-4)
    assert_allclose(found.length[:, 1], np.tile([0.09 + stretch, 0.1 - stretch], 3), atol=1e-7)
    assert_allclose(np.diff(found.joints[1::2].mean(axis=1)), 0.01 - 3.0 * stretch, atol=1e-6)


def test_a_load_lengthens_a_segment_that_becomes_narrower() -> None:
    """Without friction, the axial force is -n dh/dl with h = sqrt(R^2 - b^2)."""

    class Narrowing(Springs):
        def at(self, length: FloatArray, pressure: FloatArray) -> Answer:
            return super().at(length, pressure)._replace(widening=np.full(1, -0.5))

    found = walk(Narrowing(), np.array([0.0, 0.1]), np.zeros((1, 1)), Ground(0.0, 1e-9, 0.03, Given(2.0)))
    assert_allclose(found.force[0, 0], 2.0 * 0.5 * 0.05 / 0.04, rtol=1e-4)


def test_stiff_beam_stands_on_all_segments_and_a_taller_one_bears_more() -> None:
    """Loads K d and K (d + 1 mm) of a straight beam; without the taller one, loads are the weight over three.

    The stiffness is compared with finite differences, for a beam that bends.
    """
    weight, length, inside = np.array([0.1, 0.2, 0.2, 0.1]), np.full(3, 0.1), np.zeros(3)
    stiff = Stand(weight, 1e4, Elastic(100.0))
    height = np.array([0.05, 0.051, 0.05])
    assert_allclose(stiff.at(np.full(3, 0.05), length, inside).load, 0.2, rtol=1e-4)
    assert_allclose(stiff.at(height, length, inside).load, 0.2 + 0.1 * np.array([-1.0, 2.0, -1.0]) / 3.0, rtol=1e-3)
    soft = Stand(weight, 0.1, Elastic(100.0))
    moved = [soft.at(height + sign * np.eye(3)[0] * 1e-6, length, inside).load for sign in (1.0, -1.0)]
    assert_allclose((moved[0] - moved[1]) / 2e-6, soft.at(height, length, inside).stiffness[:, 0], rtol=1e-6)
    assert_allclose(soft.at(height, length, inside).load.sum(), weight.sum(), rtol=1e-8)


def test_patch_passes_through_the_shipped_table() -> None:
    """All rows, and the derivative between rows and pressures against finite differences; nothing without touch."""
    _, patch = soft_tables.patch()
    with netcdf_file(DATA / "barrel.nc", mmap=False) as file:
        pressure, way, load = (
            file.variables[f"pressed_{name}"][:] for name in ("pressure_Pa", "indentation_m", "load_N")
        )
    assert_allclose(patch.at(way, pressure)[0], load, rtol=1e-9)
    between, at = np.linspace(2e-4, 4e-3, 7), np.linspace(300.0, 4400.0, 7)
    moved = [patch.at(between * (1.0 + sign * 1e-6), at)[0] for sign in (1.0, -1.0)]
    assert_allclose((moved[0] - moved[1]) / (2e-6 * between), patch.at(between, at)[1], rtol=1e-6)
    assert patch.at(np.array([-1e-4]), np.array([900.0]))[0] == 0.0
