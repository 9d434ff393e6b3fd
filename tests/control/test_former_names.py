"""Modules of `control` still lead to themselves under the names that they had before they moved into rooms."""

import importlib

import pytest

import control
from control import sensing


@pytest.mark.parametrize("former", sorted(control._MOVED))
def test_a_former_name_is_the_module_itself(former: str) -> None:
    module = importlib.import_module(former)
    assert module is importlib.import_module(control._MOVED[former])
    assert module.__spec__ is not None
    assert module.__spec__.name == module.__name__ == control._MOVED[former]


def test_sensors_are_found_in_their_room_and_under_their_former_name() -> None:
    assert sensing.Sensors is importlib.import_module("control.sensors").Sensors
    assert sensing.Measurement is importlib.import_module("control.measurement").Measurement
