"""What must hold at the edges of the units that stand alone.

Each check takes the units of a build, of any number of breakpoints, and raises AssertionError where it does not hold.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from codegen.emit.reference_model_view import ARGUMENT_MAX, tabulate
from codegen.vehicle.tyre import AxleTyres
from tests.sil.units import Units


def check_limiter_at_breakpoints(units: Units) -> None:
    """At a breakpoint the bound is that of the breakpoint, to the bit, whatever those beside it are; on both sides, and with a
    speed of either sign. Bounds are taken for which a sum of differences would not give them back."""
    real = units.real
    speeds = [float(speed) for speed in units.limiter_parameters().opposite_phase_speed]
    rng = np.random.default_rng(3)
    exact = 0
    for _ in range(100):
        bounds = rng.uniform(0.0, 0.05, len(speeds)).astype(real)
        exact += int(sum(a + (b - a) != b for a, b in itertools.pairwise(bounds)))
        parameters = units.limiter_parameters(rear_rate_max=1000.0, opposite_phase_max=bounds.tolist())
        assert units.library.lib.ars_limiter_parameters_valid(parameters)
        for k, speed in enumerate(speeds):
            for sign, side in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0)):
                inputs = np.array([[sign * speed, side * 0.1, -side * 1.0]])
                assert units.limiter(parameters, inputs)[0] == real(-side) * bounds[k], (k, sign, side)
    assert exact > 3, "for some of them it matters"


def check_limiter_arrays_to_their_ends(units: Units) -> None:
    """Breakpoints from standstill to the largest speed, and no bound at all or none but the angle's own."""
    valid = units.library.lib.ars_limiter_parameters_valid
    count = len(list(units.limiter_parameters().opposite_phase_speed))
    inner = [10.0 * k for k in range(1, count - 1)]
    assert valid(units.limiter_parameters(opposite_phase_speed=[0.0, *inner, 200.0]))
    beyond = float(np.nextafter(units.real(200.0), units.real(math.inf)))
    assert not valid(units.limiter_parameters(opposite_phase_speed=[0.0, *inner, beyond]))
    for angle in (1.0, 0.5):
        for bound in (0.0, angle):
            assert valid(units.limiter_parameters(rear_angle_max=angle, opposite_phase_max=[bound] * count))
    for k in range(1, count):
        speeds = [float(j) for j in range(count)]
        assert valid(units.limiter_parameters(opposite_phase_speed=speeds))
        speeds[k] = speeds[k - 1]
        assert not valid(units.limiter_parameters(opposite_phase_speed=speeds)), "two in one place"
        speeds[k] = float(np.nextafter(units.real(speeds[k - 1]), units.real(math.inf)))
        assert valid(units.limiter_parameters(opposite_phase_speed=speeds))


def check_curves_at_their_ends(units: Units) -> None:
    """At the end of its table and beyond, a curve has the table's last value; just before, the one but last cell is over."""
    tyres = AxleTyres.from_config(units.config)
    real = units.real
    last = real(ARGUMENT_MAX)
    near = np.array([last, np.nextafter(last, real(0.0)), np.nextafter(last, real(math.inf)), 2.0 * last, math.inf], dtype=real)
    for tyre, values, mirrored in zip((tyres.front, tyres.rear), units.curves(near), units.curves(-near), strict=True):
        end = tabulate(tyre).values[-1]
        rise = abs(end - tabulate(tyre).values[-2])
        # The position rounds by three units of the number of cells, worth a cell's rise each; the rest by four units.
        assert (np.abs(values - end) <= units.eps * (3.0 * tabulate(tyre).values.size * rise + 4.0)).all()
        assert (values[2:] == values[0]).all()
        assert np.array_equal(values, -mirrored)


CHECKS = (check_limiter_at_breakpoints, check_limiter_arrays_to_their_ends)
OF_THE_MODEL = (check_curves_at_their_ends,)
