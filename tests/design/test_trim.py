"""The trim that `codegen tune` sets: the one that the build of the same map asks for."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from codegen.configuration import Config
from codegen.design import tune
from codegen.design.lead import Response
from codegen.ecu_map.model_excess import Excess
from codegen.errors import ConfigError
from codegen.judgement.build_warnings import excess_warning
from codegen.map_file import map as npz

COMMITTED = npz.load(Path(__file__).resolve().parents[2] / "generated/4ws2.npz")


@pytest.mark.parametrize(
    ("percent", "own", "least", "expected"),
    [
        (0.7, 2.0, 1.0, 2.0),  # no more than twice what is needed
        (1.8, 7.0, 1.0, 2.0),
        (1.8, 7.0, 5.0, 5.0),
        (1.8, 7.0, 7.0, 7.0),
        (1.8, 1.0, 1.0, 2.0),
        (-0.3, 3.0, 0.5, 1.0),
        (25.0, 3.0, 1.0, 20.0),
    ],
)
def test_the_trim_is_what_the_build_asks_for(
    percent: float, own: float, least: float, expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    excess = Excess(0.01 * percent, 30.0, 0.07, 0.9)
    monkeypatch.setattr(tune, "model_excess", lambda *_: excess)
    assert COMMITTED.config is not None
    config = tune.with_tracking(COMMITTED.config, {"trim_max_percent": own}, "test")
    changed, found = tune._with_trim(COMMITTED, config, least, "test")
    trim = changed.controller.tracking.trim_max_percent
    assert (trim, changed is config, found) == (expected, own == expected, excess)
    if least < expected < 20.0:
        place = {"at_km_h": 108.0, "at_front_angle_deg": 4.0, "at_friction": 0.9}
        facts = {"percent": excess.percent, "trim_max_percent": trim, "enough": excess.percent <= trim, **place}
        assert excess_warning({"reference_model_excess": facts}) == ""


def test_a_car_whose_identification_is_in_doubt_is_refused_until_its_file_accepts_it(monkeypatch: pytest.MonkeyPatch) -> None:
    class Designed(Exception):
        pass

    def designed(*_: object) -> None:
        raise Designed

    monkeypatch.setattr(tune, "design", designed)
    assert COMMITTED.config is not None
    doubted = COMMITTED.config.replace({"identified": {"doubts": ["a doubt"]}})
    with pytest.raises(
        ConfigError, match=r"identified.doubts: the identification is in doubt: a doubt; .*doubts_accepted = true"
    ):
        tune.tune(COMMITTED, doubted)
    with pytest.raises(Designed):
        tune.tune(COMMITTED, doubted.replace({"identified": {"doubts_accepted": True}}))


def test_the_response_gain_reduces_the_trim_and_the_responses_are_those_with_the_last_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    driven: list[float] = []

    def excess(_map: Any, _total: Any, config: Config) -> Excess:
        schedule = config.controller.tracking.schedule
        assert schedule is not None
        return Excess(0.062 if schedule.response_gain_s is None else 0.018, 30.0, 0.07, 0.9)

    def respond(_map: Any, config: Config, *_: Any) -> tuple[float, tuple[Response, ...]]:
        driven.append(config.controller.tracking.trim_max_percent)
        return 0.06, (Response(60.0, 0.02, 0.1, 0.5, 0.8, 0.3, 2.0),)

    config = COMMITTED.config
    assert config is not None and config.controller.tracking.schedule is not None
    gains = config.controller.tracking.schedule.model_copy(update={"lead_s": None, "response_gain_s": None})
    config = tune.with_tracking(config, {"trim_max_percent": 1.0}, "test")
    monkeypatch.setattr(tune, "design", lambda *_: SimpleNamespace(schedule=gains))
    monkeypatch.setattr(tune, "compile_controller", lambda *_: None)
    monkeypatch.setattr(tune, "model_excess", excess)
    monkeypatch.setattr(tune, "tune_response", respond)
    monkeypatch.setattr(tune, "tune_fail_safe", lambda *_: tune.FailSafeRate(3.0, ()))
    tuned = tune.tune(COMMITTED, config)
    assert driven == [7.0, 2.0]
    assert tuned.config.controller.tracking.trim_max_percent == 2.0
    assert tuned.excess is not None and tuned.excess.percent == 1.8
