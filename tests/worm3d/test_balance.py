"""Energies that an actuator declares beside the work of its force: told where they are off, else silent."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import worm3d
from worm3d import Actuator, FirstOrder, Response, Worm
from worm3d.physics import balance
from worm3d.physics.actuators import ACTUATORS
from worm3d.physics.pneumatic import Pneumatic
from worm3d.physics.technologies.presets import TECHNOLOGIES
from worm3d.values.parameters import parameter

SHIPPED = {name: kind for name, kind in ACTUATORS.items() if kind.__module__.startswith("worm3d.")} | dict(TECHNOLOGIES)


def some_worm(seed: int, part: Actuator) -> Worm:
    rng = np.random.default_rng(seed)
    return Worm(
        segments=int(rng.integers(1, 9)),
        length=float(10.0 ** rng.uniform(-1.0, 0.3)),
        k_spring=float(10.0 ** rng.uniform(0.5, 2.5)),
        half_height=float(rng.uniform(0.01, 0.05)),
        actuator_lag=float(rng.choice([0.0, 0.02, 0.2])),
        actuator=part,
    )


@pytest.mark.parametrize("name", sorted(SHIPPED))
def test_what_comes_with_worm3d_balances(name: str) -> None:
    """Far below the limit, on random worms: no false alarm, and the solver need not look."""
    for seed in range(4):
        part = SHIPPED[name]()
        found = balance.balance(part, some_worm(seed, part))
        assert found.holds
        assert found.missed <= 0.1 * balance.LARGEST_MISS * found.energy


def off(kind: type[Actuator], term: str, share: float) -> type[Actuator]:
    """Return an actuator that declares a term of its energy by a share too much."""

    class Off(kind):  # type: ignore[misc, valid-type]
        @classmethod
        def compiled(cls) -> type[Actuator]:
            return cls

        @classmethod
        def respond(cls, s: Mapping[str, Any]) -> Response:
            right = kind.respond(s)
            return right._replace(**{term: (1.0 + share) * getattr(right, term)})

    return Off


@pytest.mark.parametrize("share", [0.2, -0.2, 0.05, -0.05])
@pytest.mark.parametrize("term", ["work", "lost"])
@pytest.mark.parametrize(
    "kind", [Pneumatic, TECHNOLOGIES["sma_wire"], TECHNOLOGIES["servo_cable"], TECHNOLOGIES["dea_stack"]]
)
def test_energy_that_is_off_is_missing_by_that_share(kind: type[Actuator], term: str, share: float) -> None:
    wrong = off(kind, term, share)()
    for seed in range(3):
        found = balance.balance(wrong, some_worm(seed, wrong))
        assert not found.holds
        assert found.missed > 0.5 * abs(share) * found.energy


@dataclass(frozen=True, eq=False, kw_only=True)
class Band(Actuator):
    """A further spring along each chamber, whose energy is told `times` too often."""

    stiffness: Any = parameter(30.0, meaning="stiffness", unit="N/m", ge=0)
    times: float = parameter(1.0, meaning="factor of the energy")
    drives_hinges = False

    @classmethod
    def respond(cls, s: Mapping[str, Any]) -> Response:
        energy, energy_n = (s["stiffness"] / 2.0 * (s[name] - s["l0"]) ** 2 for name in ("length", "length_n"))
        stored = s["times"] * (energy - energy_n)
        return Response(command=s["command"], given=s["command"], potential=energy, stored=stored)


@pytest.mark.parametrize("times", [1.2, 1.05])
def test_a_spring_misses_the_share_that_is_too_much(times: float) -> None:
    """Of k/2 (l - l0)^2 at the largest stretch: a closed form."""
    part = Band(times=times)
    worm = Worm(segments=1, length=0.2, actuator=part)
    stretch = balance.MOTION_STROKE * worm.stroke[1] * worm.l0
    found = balance.balance(part, worm)
    assert_allclose(found.missed, (times - 1.0) * 15.0 * stretch**2, rtol=0.02)
    assert_allclose(found.energy, times * 15.0 * stretch**2, rtol=0.02)


def test_a_run_warns_and_its_numerical_loss_stays() -> None:
    """The numbers of the warning are those of the ledger: what is missing does not shrink with the step."""

    def lost(times: float, dt: float) -> float:
        worm = Worm(segments=2, length=0.4, actuator=Band(times=times))
        run = worm3d.simulate(
            worm,
            None,
            state=worm3d.State.straight(worm, position=(0.0, 0.0, 5.0)),
            actuation=lambda t: worm3d.Command([[0.2 * np.sin(t) ** 2, 0.1 * np.sin(t) ** 2]] * 2),
            duration=1.2,
            dt=dt,
            gravity=(0, 0, 0),
        )
        assert run.status is worm3d.Status.DONE, run.stop
        assert run.energy.balance_error < 1e-9
        return float(run.energy.numerical_loss.sum() / run.energy.actuator.sum())

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert abs(lost(1.0, 2e-3)) < 1e-3
    with pytest.warns(balance.UnbalancedEnergyWarning, match=r"Band.respond: .* J of the .* \(17%\)"):
        assert_allclose(lost(1.2, 2e-3), -1.0 / 6.0, rtol=0.01)


def test_without_energy_of_its_own_there_is_nothing_to_miss() -> None:
    assert balance.balance(FirstOrder(), Worm()) == (0.0, 0.0, 0.0)
