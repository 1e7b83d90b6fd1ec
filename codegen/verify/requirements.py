"""Requirements on the generated C with ids, and for each the contracts, checks and tests that show it.

The requirements are what the headers promise. `verify.md` and the report show the table with the results of a build;
`codegen verify --requirements FILE.csv` writes it for requirements tools.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from codegen.emit.supervision import CAUSES, reaction_of, status_text

REQUIREMENT_HEADER = ("id", "requirement", "engines", "harnesses", "tests", "result")
NOT_RUN, SHOWN = "not run", "shown"
RESULTS = ("failed", "open", NOT_RUN, SHOWN)
"""Results of a requirement, the worst first."""
ENGINES = {
    "contracts": "CBMC",
    "memory": "Frama-C EVA",
    "generator": "comparison with the generator's C",
    "sanitizers": "sanitizers and fuzzing",
    "processor-in-the-loop": "emulated processors",
    "budgets": "counted instructions and stack",
    "compiles": "compilers",
    "static-analysis": "cppcheck and GCC's analyser",
}
"""Check of `codegen verify` -> its engine."""


@dataclass(frozen=True)
class Requirement:
    """A promise of the generated C.

    Attributes:
        id: identifier, which stays the same when the text changes.
        text: one sentence, in the words of the header.
        contracts: functions, without the prefix, whose contracts prove it.
        checks: checks of `codegen verify` that test or prove it.
        tests: files below tests/.
    """

    id: str
    text: str
    contracts: tuple[str, ...] = ()
    checks: tuple[str, ...] = ()
    tests: tuple[str, ...] = ()


def _of_supervision() -> tuple[Requirement, ...]:
    """Return a requirement for each cause of the supervision's table, with the number of the cause in its id."""
    return tuple(
        Requirement(
            f"ARS-SUP-{10 + cause}",
            f"Cause {cause.name} ({row.text}): {reaction_of(cause)}; the status is {status_text(row.leads_to)}.",
            ("supervision_step",),
            (),
            ("sil/answers_task.py", "hil_sim/test_task_events.py"),
        )
        for cause, row in CAUSES.items()
    )


_TASK = "task_10ms"
STARTED, MOVED, RELEASED, RETURNED, UNCONTROLLED, HELD = (
    f"{_TASK}_{part}" for part in ("started", "moved", "released", "returned", "uncontrolled", "held")
)
"""Stand for the proofs of where the task's command starts and how it moves; their names have the period of the build."""

_PACKED = ("can_pack_vehicle_motion", "can_pack_vehicle_conditions", "can_pack_rear_steer_command")

REQUIREMENTS = (
    Requirement(
        "ARS-CTL-1",
        "The command is finite and within +-rear_angle_max, for every measurement, valid parameter set and state.",
        ("controller_init", "controller_step"),
        ("sanitizers",),
        ("sil/checks_edges.py",),
    ),
    Requirement(
        "ARS-CTL-2",
        "While tracking, the command moves in a sample by at most the lower rear_rate_max of law and limiter.",
        ("controller_step", "law_step"),
        (),
        ("sil/checks_tracking.py",),
    ),
    Requirement(
        "ARS-CTL-3",
        "In the fail-safe the magnitude of the command does not grow.",
        ("controller_step",),
        (),
        ("sil/checks_supervision.py",),
    ),
    Requirement(
        "ARS-CTL-4",
        "The status is one of its enumerators, and the command and status that are returned are those of the state.",
        ("controller_step",),
        ("sanitizers",),
    ),
    Requirement(
        "ARS-CTL-5",
        "Each command, reference and status is that of the control law, bit for bit, on every supported core.",
        (),
        ("generator", "processor-in-the-loop"),
        ("sil/test_units.py",),
    ),
    Requirement(
        "ARS-CTL-6",
        "The fail-safe starts and ends after the configured numbers of lost and good samples.",
        ("controller_step", "inputs_step"),
        ("sanitizers",),
        ("sil/checks_supervision.py",),
    ),
    Requirement(
        "ARS-CTL-7",
        "The status follows from the quality of the sample. The first good one ends standby, kind pi from enable_speed on.",
        ("controller_step",),
        (),
        ("sil/checks_supervision.py",),
    ),
    Requirement(
        "ARS-CTL-8",
        "Without control the command does not grow in magnitude. It falls to zero in the fail-safe, and in standby of kind pi.",
        ("controller_step", "limiter_step"),
        (),
        ("sil/checks_supervision.py",),
    ),
    Requirement(
        "ARS-CTL-9",
        "From the first sample of control on, the command leaves zero in a sample by at most the lower rear_rate_max.",
        ("controller_step", "law_step"),
        (),
        ("sil/checks_tracking.py",),
    ),
    Requirement(
        "ARS-CTL-10",
        "An initialisation sets each member of its state, whatever the memory held.",
        (),
        ("contracts",),
        ("sil/checks_edges.py",),
    ),
    Requirement(
        "ARS-INP-1",
        "The checked sample is finite and within its ranges, whatever was measured.",
        ("inputs_init", "inputs_step"),
        (),
        ("sil/checks_inputs.py",),
    ),
    Requirement(
        "ARS-INP-2",
        "A signal is not used after missing_samples_max missing samples, until recovery_samples good ones, less missing ones.",
        ("inputs_step",),
        (),
        ("sil/checks_inputs.py",),
    ),
    Requirement(
        "ARS-MAP-1",
        "The reference of any valid map is finite and bounded, for every speed, front angle and friction.",
        ("map_valid", "map_yaw_rate_on_road"),
        ("sanitizers",),
        ("sil/checks_lookup.py", "sil/checks_map_reference.py"),
    ),
    Requirement(
        "ARS-LIM-1",
        "The limiter's command is within +-rear_angle_max and moves by at most rear_rate_max in a sample.",
        ("limiter_init", "limiter_step"),
        (),
        ("sil/checks_limiter.py",),
    ),
    Requirement(
        "ARS-LIM-2",
        "The limiter's command lies between its last value, the demand and zero.",
        ("limiter_step",),
        (),
        ("sil/checks_limiter.py",),
    ),
    Requirement(
        "ARS-SYM-1",
        "Map and limiter are the same for left and right: mirrored angles give the mirrored result.",
        ("limiter_step_mirrored", "map_yaw_rate_on_road_mirrored"),
        (),
        ("sil/checks_lookup.py", "sil/checks_limiter.py"),
    ),
    Requirement(
        "ARS-PAR-1",
        "Parameters that the validity functions accept are within the ranges and relations that all functions require.",
        ("parameters_valid", "inputs_parameters_valid", "limiter_parameters_valid"),
        (),
        ("sil/checks_parameters.py",),
    ),
    Requirement(
        "ARS-E2E-1",
        "A frame with a wrong CRC or an invalid counter is rejected.",
        ("e2e_check",),
        ("sanitizers",),
        ("hil_sim/test_e2e.py",),
    ),
    Requirement(
        "ARS-E2E-2",
        "A sent frame carries the next counter and the right CRC.",
        ("e2e_protect",),
        ("sanitizers",),
        ("hil_sim/test_e2e.py",),
    ),
    Requirement(
        "ARS-E2E-3",
        "After the first frame, data are used only if the counter advances within its window, in sequence after a silence.",
        ("e2e_check", "e2e_no_new_data"),
        ("sanitizers",),
        ("hil_sim/test_e2e.py",),
    ),
    Requirement(
        "ARS-E2E-4",
        "The state of a message follows the thresholds of AUTOSAR's E2E state machine over the last cycles.",
        ("e2e_supervise", "e2e_supervision_init"),
        ("sanitizers",),
        ("hil_sim/test_e2e.py",),
    ),
    Requirement(
        "ARS-CAN-1",
        "A received signal is within the range of its frame, or NaN for not available.",
        ("can_unpack_vehicle_motion", "can_unpack_vehicle_conditions"),
        ("processor-in-the-loop",),
        ("hil_sim/test_codec.py",),
    ),
    Requirement(
        "ARS-CAN-2",
        "Each signal is sent in the bits that the DBC states, by the code nearest to its value, on cores of either byte order.",
        (*_PACKED, *(f"{name}_big_endian" for name in _PACKED)),
        ("processor-in-the-loop",),
        ("hil_sim/test_codec.py",),
    ),
    Requirement(
        "ARS-SUP-1",
        "After a silence of both messages that led to the fail-safe, commands start from the measured angle, or the last one.",
        ("controller_place", STARTED),
        ("sanitizers",),
        ("hil_sim/test_task_events.py",),
    ),
    Requirement(
        "ARS-SUP-2",
        "Without valid conditions, with a stuck actuator or late task, the integrator is held and the status is not TRACKING.",
        ("supervision_step",),
        ("generator",),
        ("hil_sim/test_task_events.py",),
    ),
    Requirement(
        "ARS-SUP-3",
        "Of several causes in a sample the first one of the list acts.",
        (),
        ("generator", "sanitizers"),
        ("sil/answers_task.py",),
    ),
    Requirement(
        "ARS-SUP-4",
        "Each bit of Diagnostics is set in the command of the sample in which its event was found, whatever the state.",
        (),
        ("generator",),
        ("sil/answers_task.py",),
    ),
    Requirement(
        "ARS-SUP-5",
        "The integrator is held while Inhibit is set, over single lost frames too, and while it is unknown; if it is set for"
        " longer than inhibit_samples_max, the command returns to zero.",
        (),
        ("generator",),
        ("sil/answers_task.py",),
    ),
    Requirement(
        "ARS-SUP-6",
        "From sample to sample the command moves within its rate limit, from the last command or to the measured rear angle;"
        " without control it waits for wheels that do not follow, and under control it goes no farther out.",
        (MOVED, RELEASED, RETURNED, UNCONTROLLED, HELD),
        ("sanitizers",),
        ("sil/answers_task.py",),
    ),
    *_of_supervision(),
    Requirement(
        "ARS-CAL-1",
        "The self-test detects a changed map, parameter or tyre curve.",
        (),
        ("generator",),
        ("sil/checks_selftest.py", "sil/checks_calibration.py"),
    ),
    Requirement(
        "ARS-SYS-1",
        "No function reads or writes outside an object, reads a number before it is written, or is otherwise undefined.",
        (),
        ("contracts", "memory", "sanitizers"),
        ("sil/suite_memory.py",),
    ),
    Requirement(
        "ARS-SYS-2",
        "Every call ends: each loop has a fixed number of rounds, and instructions and stack are within their budgets.",
        (),
        ("budgets",),
    ),
    Requirement(
        "ARS-SYS-3",
        "The sources compile without a warning for every supported core and need no library but for the vehicle dynamics.",
        (),
        ("compiles",),
        ("emit/test_take_over.py",),
    ),
    Requirement(
        "ARS-SYS-4",
        "The sources keep MISRA C:2012 but for the listed deviations.",
        (),
        ("static-analysis",),
        ("emit/test_deviations.py",),
    ),
)


ON_THE_CAR = (
    (
        "ARS-CAR-1",
        "The sender of VehicleConditions sends it in every cycle, and sets Inhibit in each cycle in which ESC or ABS acts.",
    ),
    (
        "ARS-CAR-2",
        "The receiver of the command checks its E2E and its age, and holds the angle while RearAngleCommand is not available.",
    ),
    (
        "ARS-CAR-3",
        "The receiver reads Status: it warns the driver in DEGRADED and STANDBY, and in FAIL_SAFE also limits the speed.",
    ),
    (
        "ARS-CAR-4",
        "The receiver stores the bits of Diagnostics for the workshop and reads no reaction from them: Status has it.",
    ),
    (
        "ARS-CAR-5",
        "The sender's RearAngle is true within rear_actuator.stuck_error_deg, or not available: at the start, and after a"
        " silence, the command starts from it.",
    ),
)
"""Requirements on the nodes at the other end of the bus, by id."""


def entries(checks: Mapping[str, Mapping[str, Any]], prefix: str, task: str = _TASK) -> list[dict[str, str]]:
    """Return a row by `REQUIREMENT_HEADER` for each requirement.

    Args:
        checks: the checks of `verify.json` by name; of each, `verdict` and `figures` are used.
        prefix: prefix of the build. Contracts that its kind does not have are left out.
        task: name of the function of the task, without the prefix; it has the period of the build.
    """
    recorded = checks.get("contracts", {}).get("figures", {}).get("harnesses")
    harnesses = recorded if isinstance(recorded, Mapping) else {}
    found = []
    for each in REQUIREMENTS:
        names = [f"{prefix}_{name.replace(_TASK, task)}" for name in each.contracts]
        proofs = [harnesses[name] for name in names if name in harnesses]
        results = [*proofs, *(checks[name]["verdict"] for name in each.checks if name in checks)]
        if len(proofs) < len(each.contracts) or not results:
            results.append(NOT_RUN)
        engines = [ENGINES[name] for name in (*(["contracts"] if each.contracts else []), *each.checks)]
        proved = [f"prove_{name}" for name in names] or ["all"] * ("contracts" in each.checks)
        worst = next((result for result in RESULTS if result in results), SHOWN)
        row = (each.id, each.text, ", ".join(engines), ", ".join(proved), ", ".join(each.tests), worst)
        found.append(dict(zip(REQUIREMENT_HEADER, row, strict=True)))
    return found


def table(rows: Sequence[Mapping[str, str]]) -> bytes:
    """Return the rows as CSV with a header."""
    text = io.StringIO()
    writer = csv.DictWriter(text, REQUIREMENT_HEADER, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode("ascii")
