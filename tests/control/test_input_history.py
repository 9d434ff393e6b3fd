"""Commands of the past and the wave in the strains, against closed forms."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.estimation.wave import FIT_SMOOTHING, InputHistory, MeasuredWave
from control.gaits.steering import BLEND, Schedule

FREQUENCY = 0.8


def phase(t: float) -> float:
    return 2.0 * np.pi * FREQUENCY * t


@pytest.fixture
def history() -> InputHistory:
    """Amplitude 0.3 up to 1 s, then -0.2; steering 0.1 and -0.05."""
    made = InputHistory(10.0)
    for k in range(21):
        t = 0.1 * k
        made.add(t, np.array([0.3, FREQUENCY, 0.1] if k <= 10 else [-0.2, FREQUENCY, -0.05]), phase(t))
    return made


def test_phase_and_frequency_are_those_of_the_instant(history: InputHistory) -> None:
    for t in (0.0, 0.03, 0.55, 1.99, 2.0):
        assert history.phase(t) == pytest.approx(phase(t))
    assert history.phase(2.1) == pytest.approx(phase(2.1)), "the wave goes on"
    assert history.frequency(0.55) == pytest.approx(FREQUENCY)
    assert [history.is_back(t) for t in (0.5, 0.95, 1.05, 3.0)] == [False, False, True, True]


def test_the_amplitude_in_force_follows_the_one_asked_for(history: InputHistory) -> None:
    """From rest it nears 0.3 as 1 - exp(-waves/BLEND); then it leaves for -0.2 in the same way."""
    rises = 0.3 * (1.0 - np.exp(-FREQUENCY * 1.0 / BLEND))
    falls = -0.2 + (rises + 0.2) * np.exp(-FREQUENCY * 0.4 / BLEND)
    for t, amplitude in ((1.0, rises), (1.4, falls)):
        (given, lasted), *more = history.between(t - 1e-6, t + 1e-6)
        assert given[0] == pytest.approx(amplitude, abs=1e-5)
        assert lasted + sum(each for _, each in more) == pytest.approx(2e-6)


def test_inputs_between_two_instants_are_those_asked_for_and_last_as_long(history: InputHistory) -> None:
    parts = list(history.between(0.45, 1.75))
    assert sum(lasted for _, lasted in parts) == pytest.approx(1.3)
    assert [given[2] for given, _ in parts] == [0.1, -0.05]
    assert [lasted for _, lasted in parts] == pytest.approx([0.55, 0.75])
    assert [given[1] for given, _ in parts] == pytest.approx([FREQUENCY] * 2)
    assert list(history.between(1.5, 1.5)) == []


def test_what_is_older_than_asked_for_is_forgotten() -> None:
    history = InputHistory(0.5)
    for k in range(300):
        history.add(0.01 * k, np.array([0.3, FREQUENCY, 0.0]), phase(0.01 * k))
    assert 50 <= len(history) <= 102
    assert history.phase(2.5) == pytest.approx(phase(2.5))


@pytest.mark.parametrize("direction", ["retrograde", "direct"])
@pytest.mark.parametrize("back", [False, True])
def test_the_wave_in_the_strains_is_found(direction, back: bool) -> None:
    """(W1) and (W2): s_i = mean + Re(a exp(i (k x_i +- psi))); backwards it runs from the head and counts as -wave."""
    schedule = Schedule(direction=direction)
    measured, a, sign = MeasuredWave(6, schedule), 0.1 * np.exp(0.7j), 1.0 if direction == "retrograde" else -1.0
    x = 2.0 * np.pi * (np.arange(6) + 0.5) / 6 / schedule.wavelength
    for k in range(41):
        strain = -0.05 + np.real(a * np.exp(1j * (x + sign * 0.2 * k)))
        if k % 3 == 1:
            strain[k % 6] = np.nan  # one chamber that is not known
        sides = np.column_stack([strain, strain])[:: -1 if back else 1]
        measured.take(sides, 0.2 * k, back)
    found = 1.0 - np.exp(-0.2 * 40 / (2.0 * np.pi) / FIT_SMOOTHING)
    assert (measured.backward if back else measured.amplitude) == pytest.approx(found * a)
    assert (measured.amplitude if back else measured.backward) == 0.0
    expected = (-1.0 if back else 1.0) * found * a * np.exp(1j * sign * 1.3)
    assert_allclose(measured.at(1.3), [expected.real, expected.imag])
