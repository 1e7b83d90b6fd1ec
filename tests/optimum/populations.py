"""Cars whose tyres are known only with standard deviations, as `codegen identify` writes them."""

from codegen.configuration import Config
from tests.optimum.cars import changed

KEYS = {
    "tyre.front.cornering_stiffness_n_per_rad": 0.02,
    "tyre.front.peak_factor_p1": 0.02,
    "tyre.rear.cornering_stiffness_n_per_rad": 0.02,
    "tyre.rear.peak_factor_p1": 0.01,
}
"""Key -> standard deviation as a fraction of its value."""
CORRELATIONS = [[1.0, 0.1, 0.7, 0.0], [0.1, 1.0, 0.1, 0.2], [0.7, 0.1, 1.0, 0.2], [0.0, 0.2, 0.2, 1.0]]


def uncertain(config: Config) -> Config:
    """Return the configuration with `[identified]`."""
    values = []
    for key in KEYS:
        _, axle, name = key.split(".")
        values.append(float(getattr(getattr(config.tyre, axle), name)))
    deviations = [share * value for share, value in zip(KEYS.values(), values, strict=True)]
    return changed(
        config,
        identified={
            "keys": list(KEYS),
            "standard_deviations": deviations,
            "correlations": CORRELATIONS,
            "interval_floor_percent": 0.0,
        },
    )
