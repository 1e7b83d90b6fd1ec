"""What the manifest states of chosen breakpoints."""

from __future__ import annotations

from tests import builds
from tests.sil.placed import BOUND, check_placed, placed


def test_the_manifest_states_request_scales_and_errors() -> None:
    case, found = placed("pi", "single", "int16")
    check_placed(case, found)
    facts, options = case.built.folder.manifest["map"], case.built.folder.manifest["options"]
    assert (options["max_error_rad_s"], options["max_flash_bytes"], options["storage"]) == (BOUND, None, "int16")
    assert found.total.scales is not None
    scale = found.total.scales.yaw_rate
    assert facts["storage"]["yaw_rate"]["scale_rad_s"] == scale
    assert 0.0 < facts["storage"]["yaw_rate"]["largest_rounding_rad_s"] <= 0.5001 * scale
    assert found.error.yaw_rate_whole <= facts["placement"]["error_whole_domain_rad_s"] <= BOUND * 1.001
    manifest = builds.paper().folder.manifest
    assert manifest["options"].keys() == {"prefix", "precision", "kind"}, "without a request it states none"
    assert not {"placement", "storage"} & manifest["map"].keys()
