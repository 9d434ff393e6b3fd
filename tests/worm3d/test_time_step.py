"""How far the default time step of 10 ms is from a twentieth of it: the distance that a worm crawls in 10 s."""

import pytest

from control.gaits import TravellingWave
from worm3d import Plane, Status, Worm, simulate
from worm3d.running.problem import Integrator

WORMS = {"default": Worm(), "lightly damped": Worm(kelvin_voigt_time=0.01), "20 segments": Worm(segments=20)}


def distance(worm: Worm, dt: float, integrator: Integrator = "bdf2") -> float:
    steps = round(10.0 / dt)
    result = simulate(worm, Plane(), actuation=TravellingWave(), dt=dt, integrator=integrator, record_every=steps // 10)
    assert result.status is Status.DONE
    return result.distance


@pytest.mark.parametrize("name", WORMS)
def test_bdf2_at_ten_milliseconds_is_within_one_per_cent(name: str) -> None:
    fine = distance(WORMS[name], 5e-4)
    error, first_order = (distance(WORMS[name], 0.01, each) / fine - 1.0 for each in ("bdf2", "implicit_euler"))
    assert abs(error) < 0.01
    assert abs(error) < 0.5 * abs(first_order), "what BDF2 is for"


def test_work_and_cost_of_transport_are_within_one_per_cent() -> None:
    """Commands and strains move on together: the work of the actuators is second order, too."""
    runs = [simulate(Worm(), Plane(), actuation=TravellingWave(), dt=dt, record_every=10) for dt in (0.01, 1e-3)]
    coarse, fine = (run.summary()["cost_of_transport"] for run in runs)
    assert coarse == pytest.approx(fine, rel=0.01)
    assert abs(runs[0].energy.numerical_loss.sum()) < 0.01 * runs[0].energy.work_contract.sum()
