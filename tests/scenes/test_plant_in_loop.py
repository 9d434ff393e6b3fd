"""The controller that plans on a copy of the plant: its copy, its derivatives, and what it does on a path."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from control.sensing.sensors import Measurement
from control.tracking.references import Constant
from scenes.language.errors import SceneError
from scenes.models.control.build import controller_of
from scenes.models.control.plant_in_loop import LEAST, PlantInLoop
from scenes.models.loading import load_scene
from scenes.running.runner import simulate

PLANT = (
    "controller.kind=scenes.models.control.plant_in_loop:PlantInLoop",
    "controller.mechanism=both",
    "controller.period_s=0.5",
    "run.record_every=1",
)


def started(*overrides: str) -> PlantInLoop:
    found = controller_of(load_scene("path_circle", [*PLANT, *overrides]).settings)  # type: ignore[arg-type]
    assert isinstance(found, PlantInLoop)
    found.reset()
    return found


@pytest.fixture(autouse=True)
def _quiet(capsys: pytest.CaptureFixture[str]) -> Any:
    """The name of the module that a scene runs is printed."""
    yield
    capsys.readouterr()


def test_its_worm_equals_the_worm_of_the_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bit for bit, in a bend of a pipe, although the commands depend on plans. Exact sensors measure the same place."""
    places: list[np.ndarray] = []
    step = PlantInLoop.step

    def watched(self: PlantInLoop, t: float, measurement: Measurement) -> Any:
        places.append(self._twin.observation().com)
        return step(self, t, measurement)

    monkeypatch.setattr(PlantInLoop, "step", watched)
    pieces = 'world.pieces=[{straight_m=0.5},{bend_deg=45.0,bend_radius_m=1.5,towards="left"},{straight_m=3.0}]'
    run = simulate(load_scene("velocity_pipe", [*PLANT, pieces, "run.duration_s=1.2"]))
    np.testing.assert_allclose(np.array(places), run["com"][:-1], rtol=0.0, atol=1e-14)


def test_its_derivatives_are_those_of_its_residuals() -> None:
    found = started("reference.radius_m=0.5")
    found._near = 0.1
    at = np.array([0.23, 0.8, 0.05, 0.1])
    here = found._rollout(0.0, at, LEAST, LEAST)
    assert here is not None
    for i in range(4):
        by = 1e-6 * np.eye(4)[i]
        more, less = (found._rollout(0.0, at + sign * by, LEAST, LEAST) for sign in (1.0, -1.0))
        assert more is not None
        assert less is not None
        difference = (more.residuals - less.residuals) / 2e-6
        np.testing.assert_allclose(here.jacobian[:, i], difference, atol=1e-5 * np.abs(difference).max())


@pytest.mark.parametrize(("start", "side"), [(0.05, -1.0), (-0.05, 1.0)])
def test_beside_a_line_it_steers_back_to_the_line(start: float, side: float) -> None:
    """The line is to the right of the worm, or to its left; mirrored starts give mirrored paths."""
    scene = load_scene("path_line", [*PLANT, f"reference.start_m=[0.5,{start}]", "run.duration_s=4"])
    run = simulate(scene)
    moved = run["com"][-1, 1] - run["com"][0, 1]
    assert side * moved < -0.002
    assert run.summary["mpc_failures"] == 0


def test_its_worm_goes_on_after_the_duration_of_the_scene() -> None:
    """As in a played run: the path of a copy for 0.1 s is the path of a copy for longer."""
    short, long = (started(f"run.duration_s={duration}") for duration in (0.1, 1.0))
    for k in range(25):
        for each in (short, long):
            each.step(0.01 * k, Measurement(0.01 * k))
    np.testing.assert_array_equal(short._twin.observation().com, long._twin.observation().com)


def test_steered_away_from_the_path_it_stands() -> None:
    found = started()
    found.lead(replace(found.reference, path=None, heading=Constant(0.3), ends=False))
    assert not found.step(0.0, Measurement(0.0)).contraction.any()
    assert "no path" in found.decisions[-1].status


def test_it_needs_a_path() -> None:
    with pytest.raises(SceneError, match="got no path, must have one"):
        controller_of(load_scene("heading_hold", [*PLANT]).settings)  # type: ignore[arg-type]
