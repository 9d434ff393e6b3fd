"""Splines and chain of the benchmark of soft segments: against SciPy, the shipped law, and a walk in closed form."""

import casadi as ca
import numpy as np
from interpolated_law import GRIDS, Bent, Interpolated, Points, bending, of_learned
from numpy.testing import assert_allclose
from soft_chain import Answer, Drive, Ground, OfLaw, walk

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


def test_inchworm_walks_by_its_stroke_less_the_stretch_of_friction() -> None:
    """One spring with contacts at its ends: the tail slides while it shortens, the head while it lengthens.

    Friction of the tail stretches the spring by mu_f load/k while it shortens. Friction of the head presses it together
    by as much while it lengthens. The stroke of 10 mm loses both.
    """
    cycles = np.tile([10.0, 0.0], 3)[:, None]
    load = np.tile([0.0, 2.0, 2.0], (6, 1))
    ground = Ground(0.05, 0.4, 0.03)
    found = walk(Springs(), np.array([0.0, 0.1]), Drive(cycles, load, np.zeros((6, 3))), ground)
    stretch = 0.05 * 2.0 / 1e3
    assert_allclose(found.force[:, 0], np.tile([0.1, -0.1], 3), atol=1e-4)
    assert_allclose(found.length[:, 0], np.tile([0.09 + stretch, 0.1 - stretch], 3), atol=1e-7)
    assert_allclose(np.diff(found.joints[1::2].mean(axis=1)), 0.01 - 2.0 * stretch, atol=1e-6)


def test_a_load_lengthens_a_segment_that_becomes_narrower() -> None:
    """Without friction, the axial force is -n dh/dl with h = sqrt(R^2 - b^2)."""

    class Narrowing(Springs):
        def at(self, length: FloatArray, pressure: FloatArray) -> Answer:
            return super().at(length, pressure)._replace(widening=np.full(1, -0.5))

    drive = Drive(np.zeros((1, 1)), np.array([[2.0, 0.0, 0.0]]), np.zeros((1, 3)))
    found = walk(Narrowing(), np.array([0.0, 0.1]), drive, Ground(0.0, 1e-9, 0.03))
    assert_allclose(found.force[0, 0], 2.0 * 0.5 * 0.05 / 0.04, rtol=1e-4)
