"""Frequency response of the yaw rate to the steering wheel (ISO 7401:2011, clauses 12 and 14)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from hil_sim.metrics.run import Metric, Run, common

LOW, HIGH = 0.2, 3.5
"""Range of the sweep that is evaluated, in Hz; the sweep's ends are faded in and out."""
BAND_HALF_WIDTH_FRACTION = 0.03
"""Half of the width of the bands over which spectra are added, as a fraction of the frequency; at least 1.5 lines."""
POINTS_PER_OCTAVE = 12
BANDWIDTH_SHARE = 10.0 ** (-3.0 / 20.0)
"""Fraction of the gain at LOW that is -3 dB."""
BANDWIDTH_PHASE = -math.pi / 4.0
"""Phase, in rad, at which the phase bandwidth is read."""


@dataclass(frozen=True)
class FrequencyResponse:
    """Yaw rate over steering wheel angle.

    Attributes:
        frequency: (n,) Hz, evenly spaced on a logarithmic axis from LOW to HIGH.
        gain: (n,) 1/s.
        phase: (n,) rad, without jumps, below zero where the car lags.
    """

    frequency: FloatArray
    gain: FloatArray
    phase: FloatArray

    def where_gain_falls(self, share: float) -> float | None:
        """Return the frequency in Hz at which the gain first falls below `share` of that at LOW; None where it does not."""
        return _first_fall(self.frequency, self.gain / self.gain[0], share)

    def where_phase_falls(self, phase: float) -> float | None:
        """Return the frequency in Hz at which the phase first falls below `phase` (rad); None where it does not."""
        return _first_fall(self.frequency, self.phase, phase)


def _first_fall(frequency: FloatArray, values: FloatArray, level: float) -> float | None:
    below = np.flatnonzero(values < level)
    if not below.size:
        return None
    index = int(below[0])
    if index == 0:
        return None  # it fell below a frequency that was not driven
    logarithm = np.log(frequency)
    share = (level - values[index - 1]) / (values[index] - values[index - 1])
    return float(math.exp(logarithm[index - 1] + share * (logarithm[index] - logarithm[index - 1])))


def frequency_response(run: Run) -> FrequencyResponse | None:
    """Return the H1 estimate (cross spectrum over input spectrum) of the whole run; None where the wheel is not moved.

    Input and response begin and end at rest, so the transforms need no window and the estimate of a linear car is exact.
    Spectra are added over bands to reduce the noise of a slightly nonlinear car.
    """
    wheel, yaw_rate = run.steering_wheel_angle, run["yaw_rate_rad_s"]
    spectrum = np.fft.rfft(wheel)
    lines = np.fft.rfftfreq(len(wheel), run.step)
    power = np.abs(spectrum) ** 2
    cross = np.conj(spectrum) * np.fft.rfft(yaw_rate)
    count = 1 + math.ceil(POINTS_PER_OCTAVE * math.log2(HIGH / LOW))
    frequency = np.geomspace(LOW, HIGH, count)
    response: list[complex] = []
    for centre in frequency:
        half_width = max(BAND_HALF_WIDTH_FRACTION * centre, 1.5 * lines[1])
        weight = np.clip(1.0 - np.abs(lines - centre) / half_width, 0.0, None)
        in_band = float((weight * power).sum())
        if in_band <= 1e-12:
            return None
        response.append(complex((weight * cross).sum()) / in_band)
    values: npt.NDArray[np.complex128] = np.array(response)
    return FrequencyResponse(frequency, np.abs(values), np.unwrap(np.angle(values)))


def measure(run: Run) -> list[Metric]:
    """Return the bandwidth by both usual definitions, the resonance and the phase."""
    found = frequency_response(run)
    rows: list[tuple[str, str, str, float | None, int]]
    titles = (
        ("yaw_rate_gain_per_s", f"yaw-rate gain at {LOW:g} Hz", "1/s", 3),
        ("resonance_ratio", "largest gain over it", "-", 2),
        ("resonance_frequency_hz", "frequency of the largest gain", "Hz", 2),
        ("bandwidth_3_db_hz", "bandwidth, gain -3 dB", "Hz", 2),
        ("bandwidth_45_deg_hz", "bandwidth, phase -45 deg", "Hz", 2),
        ("phase_at_1_hz_deg", "phase at 1 Hz", "deg", 1),
    )
    values: tuple[float | None, ...] = (None,) * len(titles)
    if found is not None:
        top = int(np.argmax(found.gain))
        values = (
            float(found.gain[0]),
            float(found.gain[top] / found.gain[0]),
            float(found.frequency[top]),
            found.where_gain_falls(BANDWIDTH_SHARE),
            found.where_phase_falls(BANDWIDTH_PHASE),
            math.degrees(float(np.interp(0.0, np.log(found.frequency), found.phase))),
        )
    rows = [(key, title, unit, value, digits) for (key, title, unit, digits), value in zip(titles, values, strict=True)]
    return [*(Metric(*row) for row in rows), *common(run)]
