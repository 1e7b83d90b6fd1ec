"""The same car on a road of another friction."""

from __future__ import annotations

from codegen.configuration import Config, parse
from codegen.vehicle.tyre import MagicFormulaTyre, static_wheel_loads


def on_road(config: Config, friction: float) -> Config:
    """Return the configuration of the same car for a map with the design friction `friction`.

    The tyre itself must not change with the road: B stays what it is at the friction of `config` and the peak D goes with the
    friction, so cornering stiffness goes with it too, and the slip bound stays. Another `road.friction` alone would give a tyre
    of given cornering stiffness another B; so the tyres are given by B here. On the road of `config` the forces are the same.

    Raises:
        ConfigError: the friction (or B) is none that a configuration may have.
    """
    tyres = {}
    for axle, load in zip(("front", "rear"), static_wheel_loads(config), strict=True):
        tyre = getattr(config.tyre, axle)
        factor = MagicFormulaTyre.from_config(tyre, load, config.road.friction).stiffness_factor
        tyres[axle] = tyre.model_copy(update={"cornering_stiffness_n_per_rad": None, "stiffness_factor_b_per_rad": factor})
    changed = config.model_copy(
        update={
            "road": config.road.model_copy(update={"friction": friction}),
            "tyre": config.tyre.model_copy(update=tyres),
        }
    )
    # Copies are unchecked, and this one may end in a file.
    return parse(changed.model_dump(mode="json"), f"on a road of friction {friction:g}")
