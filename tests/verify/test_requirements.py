"""The table of requirements: the evidence that it names exists, and each result is the worst of its evidence."""

import csv
from pathlib import Path
from typing import Any

import pytest

from codegen.verify import requirements
from codegen.verify.outcomes import Verdict
from codegen.verify.requirements import REQUIREMENTS
from codegen.verify.runner import CHECKS
from tests.verify import builds

TESTS = Path(__file__).parents[1]


Checks = dict[str, dict[str, Any]]


def checks(**changed: Verdict) -> Checks:
    """Return the checks of a record, all passed but for those that are changed."""
    verdicts = {check.name: changed.get(check.name.replace("-", "_"), Verdict.PASSED) for check in CHECKS}
    proofs = {f"ars_{name}": "proved" for each in REQUIREMENTS for name in each.contracts}
    found: Checks = {name: {"verdict": str(verdict), "figures": {}} for name, verdict in verdicts.items()}
    return {**found, "contracts": {"verdict": "passed", "figures": {"harnesses": proofs}}}


def results(found: Checks) -> dict[str, str]:
    return {row["id"]: row["result"] for row in requirements.entries(found, "ars")}


def test_every_piece_of_evidence_exists() -> None:
    harnesses = {path.removeprefix("verify/prove_ars_").removesuffix(".c") for path in builds.made("tracking", "uneven").files}
    for each in REQUIREMENTS:
        assert each.contracts or each.checks, each.id
        assert set(each.contracts) <= harnesses, each.id
        assert set(each.checks) <= {check.name for check in CHECKS}, each.id
        assert all((TESTS / path).is_file() for path in each.tests), each.id
    assert len({each.id for each in REQUIREMENTS}) == len(REQUIREMENTS)


def test_a_requirement_has_the_worst_result_of_its_evidence() -> None:
    assert set(results(checks()).values()) == {"shown"}
    assert results(checks(budgets=Verdict.FAILED))["ARS-SYS-2"] == "failed"
    assert results(checks(budgets=Verdict.NOT_RUN))["ARS-SYS-2"] == "not run"


@pytest.mark.parametrize("state", ["open", "failed"])
def test_an_open_or_failed_contract_shows_in_its_requirements(state: str) -> None:
    found = checks()
    found["contracts"]["figures"]["harnesses"]["ars_limiter_step"] = state
    assert {key for key, result in results(found).items() if result == state} == {"ARS-CTL-8", "ARS-LIM-1", "ARS-LIM-2"}


def test_the_proofs_of_the_task_have_the_period_of_the_build() -> None:
    found = checks()
    harnesses = found["contracts"]["figures"]["harnesses"]
    found["contracts"]["figures"]["harnesses"] = {
        name.replace("task_10ms", "task_5ms"): each for name, each in harnesses.items()
    }
    own = requirements.entries(found, "ars", "task_5ms")
    assert {row["result"] for row in own} == {"shown"} and "prove_ars_task_5ms_held" in str(own)
    assert "not run" in results(found).values()


def test_without_proofs_their_requirements_are_not_run() -> None:
    found = {**checks(), "contracts": {"verdict": str(Verdict.NOT_RUN), "figures": {}}}
    assert results(found)["ARS-CTL-1"] == "not run"


def test_the_table_reads_back_as_csv() -> None:
    header, *rows = csv.reader(requirements.table(requirements.entries(checks(), "ars")).decode().splitlines())
    assert tuple(header) == requirements.REQUIREMENT_HEADER
    assert [row[0] for row in rows] == [each.id for each in REQUIREMENTS]
