"""Metrics of steady turns and of the frequency response to the steering wheel.

Slowly increasing steer at constant speed: ISO 4138:2021; FMVSS 126, S7.6. Frequency response: ISO 7401:2011, clauses 12 and 14.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from codegen.arrays import BoolArray, FloatArray
from codegen.units import STANDARD_GRAVITY
from hil_sim.manoeuvres import DWELL_ACCELERATION
from hil_sim.metrics.run import Metric, Run, common

FIT_FROM, FIT_TO = 0.1 * STANDARD_GRAVITY, 0.375 * STANDARD_GRAVITY
"""Range of lateral acceleration, in m/s^2, over which a line is fitted (FMVSS 126, S7.6.1); tyres are nearly linear there."""


@dataclass(frozen=True)
class Line:
    """Straight line fitted to an angle over the lateral acceleration: rad s^2/m and rad."""

    slope: float
    offset: float


def fit_samples(run: Run) -> BoolArray:
    """Return the samples of the ramp from where the lateral acceleration enters the range of the fit to where it leaves it."""
    lateral = np.abs(run["lateral_acceleration_m_s2"])
    beyond = np.flatnonzero(run.after & (lateral > FIT_TO))
    before = np.arange(len(lateral)) < (beyond[0] if beyond.size else len(lateral))
    result: BoolArray = run.after & before & (lateral >= FIT_FROM)
    return result


def fit(run: Run, angle: FloatArray) -> Line | None:
    """Return the line of an angle (samples,) in rad over the lateral acceleration; None where the range was not driven."""
    lateral, chosen = run["lateral_acceleration_m_s2"], fit_samples(run)
    if chosen.sum() < 10 or np.ptp(lateral[chosen]) < 0.5 * (FIT_TO - FIT_FROM):
        return None
    slope, offset = np.polyfit(lateral[chosen], angle[chosen], 1)
    return Line(float(slope), float(offset))


def understeer_gradient(run: Run) -> float | None:
    """Return the slope of the front angle over the lateral acceleration minus L/vx^2 of a neutral car, in rad s^2/m."""
    line = fit(run, run["front_angle_rad"])
    if line is None:
        return None
    speed = float(run["speed_m_s"][fit_samples(run)].mean())
    return line.slope - run.config.vehicle.wheelbase / speed**2


def measure_ramp(run: Run) -> list[Metric]:
    """Return the understeer and sideslip gradients, in deg for each m/s^2, and the angles at 0.3 g."""
    chosen = fit_samples(run)
    end = float(run.time[chosen][-1]) if chosen.any() else math.inf
    gradient = understeer_gradient(run)
    sideslip, wheel, rear = (
        fit(run, values) for values in (run["sideslip_rad"], run.steering_wheel_angle, run["rear_angle_rad"])
    )

    def degrees(value: float | None) -> float | None:
        return None if value is None else math.degrees(value)

    def at_03_g(line: Line | None) -> float | None:
        return (
            None
            if line is None
            else line.slope * math.copysign(DWELL_ACCELERATION, run.at(end, "front_angle_rad")) + line.offset
        )

    return [
        Metric("understeer_gradient_deg_s2_m", "understeer gradient", "deg s^2/m", degrees(gradient), 4, end),
        Metric(
            "sideslip_gradient_deg_s2_m",
            "sideslip gradient",
            "deg s^2/m",
            degrees(sideslip.slope if sideslip else None),
            4,
            end,
        ),
        Metric("steering_wheel_at_0_3_g_deg", "steering wheel angle at 0.3 g", "deg", degrees(at_03_g(wheel)), 2, end),
        Metric("rear_angle_at_0_3_g_deg", "rear angle at 0.3 g", "deg", degrees(at_03_g(rear)), 2, end),
        *common(run),
    ]


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


def measure_frequency_response(run: Run) -> list[Metric]:
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
