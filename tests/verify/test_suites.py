"""Settings for which the fault catalogue's outcomes are defined."""

from codegen.configuration import preset
from codegen.verify.drives import are_faults_defined_for


def test_faults_are_defined_for_any_rate_of_the_fail_safe_that_tune_sets() -> None:
    def with_fail_safe(**values: float) -> bool:
        return are_faults_defined_for(preset("recommended").replace({"controller": {"fail_safe": values}}))

    assert with_fail_safe(rate_deg_s=12.0)
    assert not with_fail_safe(degraded_samples_max=5)
    assert not with_fail_safe(recovery_samples=20)
