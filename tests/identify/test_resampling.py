"""Resampling has no delay of its own."""

import numpy as np
import pytest

from codegen.arrays import FloatArray
from codegen.identify.conditioning import Conditioned
from codegen.identify.reading import resample

STEP = 0.01
GRID = STEP * np.arange(2000)
RIPPLE = 10.0 ** (-53.0 / 20.0)
"""Ripple of the passband and gain of the stopband: 53 dB for a Kaiser window of beta 5."""


def phase_and_gain(values: FloatArray, frequency: float) -> tuple[float, float]:
    """Return the phase in rad and the gain of a sine of amplitude 1 and phase 0 in values on GRID, by least squares."""
    has_value = np.isfinite(values)
    angle = 2.0 * np.pi * frequency * GRID[has_value]
    basis = np.column_stack((np.sin(angle), np.cos(angle), np.ones(angle.size)))
    (sine, cosine, _), *_ = np.linalg.lstsq(basis, values[has_value], rcond=None)
    return float(np.arctan2(cosine, sine)), float(np.hypot(sine, cosine))


@pytest.mark.parametrize("period", [0.0005, 0.001, 0.005, 0.007, 0.01, 0.023])
@pytest.mark.parametrize("start", [-0.05, -0.0437])
def test_a_sine_keeps_its_phase(period: float, start: float) -> None:
    frequency = 2.0
    time = np.arange(start, 20.1, period)
    time += 0.1 * period * np.sin(np.arange(time.size))  # jitter
    signal = Conditioned(time, np.sin(2.0 * np.pi * frequency * time), period)
    phase, gain = phase_and_gain(resample(signal, GRID, is_held=False), frequency)
    # A delay of 0.01 ms would be 1.3e-4 rad. Interpolation errors average out over the phases of the samples.
    assert abs(phase) < 1.3e-4
    # Linear interpolation lowers the gain by (2 pi f h)^2/12 on average, 0.7 % for 23 ms; with jitter by some more.
    assert gain == pytest.approx(1.0, abs=(2.0 * np.pi * frequency * period) ** 2 / 6.0 + RIPPLE)


def test_frequencies_above_the_grid_do_not_appear() -> None:
    time = np.arange(-0.1, 20.1, 0.001)
    low, high = 2.0, 98.0  # which a grid of 100 Hz shows at 2 Hz
    both = Conditioned(time, np.sin(2.0 * np.pi * low * time) + 0.5 * np.sin(2.0 * np.pi * high * time + 1.0), 0.001)
    phase, gain = phase_and_gain(resample(both, GRID, is_held=False), low)
    assert abs(phase) < 0.5 * RIPPLE
    assert gain == pytest.approx(1.0, abs=1.5 * RIPPLE)


@pytest.mark.parametrize(("frequency", "period"), [(50.0, 0.001), (55.0, 0.001), (98.0, 0.001), (451.0, 0.001), (72.0, 0.002)])
def test_frequencies_above_half_the_rate_vanish(frequency: float, period: float) -> None:
    time = np.arange(-0.1, 20.1, period)
    found = resample(Conditioned(time, np.sin(2.0 * np.pi * frequency * time + 1.0), period), GRID, is_held=False)
    assert np.nanmax(np.abs(found)) < RIPPLE


def test_a_gap_has_no_value_and_its_edges_have() -> None:
    time = np.delete(np.arange(0.0, 20.0, STEP), np.s_[500:503])
    values = resample(Conditioned(time, time.copy(), STEP), GRID, is_held=False)
    assert np.flatnonzero(np.isnan(values)).tolist() == [500, 501, 502]
    one_lost = np.delete(np.arange(0.0, 20.0, STEP), 500)
    np.testing.assert_allclose(resample(Conditioned(one_lost, one_lost.copy(), STEP), GRID, is_held=False), GRID, atol=1e-12)


def test_a_missing_value_spreads_to_the_neighbouring_steps_only() -> None:
    time = np.arange(0.0, 20.0, 0.004)
    values = time.copy()
    values[1000] = np.nan  # at 4 s, between the steps 399 and 401
    found = resample(Conditioned(time, values, 0.02), GRID, is_held=False)
    assert set(np.flatnonzero(np.isnan(found))) <= {399, 400, 401}
    assert np.isnan(found[400])


def test_a_command_holds_until_the_next_frame() -> None:
    time = np.arange(0.0, 20.0, 0.02) + 0.001
    command = np.arange(time.size, dtype=np.float64)
    held = resample(Conditioned(time, command, 0.02), GRID, is_held=True)
    assert np.isnan(held[0])
    assert held[1:7].tolist() == [0.0, 0.0, 1.0, 1.0, 2.0, 2.0]


def test_a_command_at_the_time_of_the_grid_counts_at_once_in_spite_of_rounding() -> None:
    unix = 1.7e9 + STEP * np.arange(2000)
    held = resample(Conditioned(unix - unix[0], np.arange(2000.0), STEP), GRID, is_held=True)
    np.testing.assert_array_equal(held, np.arange(2000.0))
