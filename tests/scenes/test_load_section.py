"""The section [load]: a payload or a tether by name, with its keys, mistakes, summary and file."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import worm3d
from scenes.commands.cli import main
from scenes.language.errors import SceneError
from scenes.models.loading import load_scene
from scenes.models.worm.build import worm_of


def worm(*overrides: str) -> worm3d.Worm:
    return worm_of(load_scene("flat", overrides).settings)


def test_the_keys_are_the_parameters() -> None:
    assert worm().loads == ()
    assert worm("load.kind=payload", "load.mass_kg=0.05", "load.joint=2").load == worm3d.Payload(mass=0.05, joint=2)
    keys = (
        "load.kind=tether",
        "load.weight_N_m=0.4",
        "load.friction=0.5",
        "load.static_ratio=1.2",
        "load.free_length_m=0.1",
    )
    assert worm(*keys).load == worm3d.Tether(weight=0.4, friction=0.5, static_ratio=1.2, free_length=0.1)


def command(*arguments: str) -> None:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 0


@pytest.mark.parametrize(
    ("overrides", "sentence"),
    [
        (("load.kind=payload", "load.joint=9"), r"^override load.joint: got 9, must be from 0, the tail, to 6"),
        (
            ("load.kind=payload", "load.mass_kg=-1"),
            "^override load.mass_kg: got -1: input should be greater",
        ),
        (("load.kind=thether",), "^override load.kind: got 'thether': .*; did you mean 'tether'"),
        (("load.kind=payload", "load.weight_N_m=1"), "^override load.weight_N_m: only for load.kind = 'tether'"),
        (
            ("load.kind=payload", "load.mass_kg=1e13"),
            "^override load.mass_kg: got 1000.* kg, must be of a size",
        ),
        (
            ("load.kind=payload", "load.mass_kg=1"),
            "pressed flat: .*; carry less, or make spring_N or half_",
        ),
    ],
)
def test_mistakes(overrides: tuple[str, ...], sentence: str) -> None:
    with pytest.raises(SceneError, match=sentence) as caught:
        worm(*overrides)
    assert len(caught.value.lines) == 1


def test_a_run_from_a_scene_goes_on_and_says_what_it_dragged(tmp_path: Path) -> None:
    """Cut in two and resumed, it is the run that was never cut; the summary has both costs of transport."""
    drags = ["-o", "load.kind=tether", "-o", "load.weight_N_m=0.4", "-o", "gait.period_s=1", "--quiet"]
    for name, duration in (("whole", "1.2"), ("first", "0.8")):
        arguments = ["run", "flat", "-o", f"run.duration_s={duration}", *drags, "--out", str(tmp_path / name)]
        command(*arguments)
    command("resume", str(tmp_path / "first"), "--duration", "0.4", "--out", str(tmp_path / "on"), "--quiet")
    whole, on = (worm3d.load(tmp_path / name) for name in ("whole", "on"))
    np.testing.assert_array_equal(on.joints[-1], whole.joints[-1])
    laid = whole.actuator_states["load_laid"]
    assert laid[-1] > 0.01
    assert_allclose(whole.actuator_states["load_resistance"], 0.12 * laid, rtol=1e-12, atol=1e-15)
    assert json.loads((tmp_path / "whole" / "summary.json").read_text())["cost_of_transport_with_load"] is None
