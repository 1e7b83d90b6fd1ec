"""SI values of other units, and gravity."""

import math

KM_H = 1.0 / 3.6
"""m/s per km/h."""
DEGREE = math.radians(1.0)
"""rad per degree."""
GRAVITY = 9.81
"""m/s^2; the default of `road.gravity_m_s2`."""
STANDARD_GRAVITY = 9.80665
"""m/s^2 per g, by definition."""
