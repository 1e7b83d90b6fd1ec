"""The safety manual: true for every kind of map, precision and controller, with the results of the checks in it."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from codegen import config as configuration
from codegen.config import Config
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.refmap.map import ReferenceMap, from_arrays
from codegen.refmap.place import Request
from codegen.refmap.solve import solve_case
from codegen.verify import manual
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.runner import CHECKS, Report
from tests.verify import builds

DIGEST = "0123456789abcdef" * 4
SPEED, FRONT_ANGLE = np.linspace(5.0, 35.0, 7), np.radians(np.linspace(0.5, 8.0, 6))
"""18 to 126 km/h and 0.5 to 8 deg: other than the grid of any preset."""
YAW_RATE = np.minimum(
    0.8 * SPEED[:, np.newaxis] * FRONT_ANGLE / (2.8 + 0.003 * SPEED[:, np.newaxis] ** 2), 7.0 / SPEED[:, np.newaxis]
)


def text_of(manifest: Mapping[str, Any], outcomes: Mapping[str, Outcome] | None = None, quick: bool = False) -> str:
    """The manual, without the line breaks inside its sentences."""
    subject = Subject("sample", {}, manifest, (), DIGEST)
    text = manual.manual(Report(subject, Effort(quick), outcomes or {}))
    assert text.isascii()
    assert "None" not in text, "a value that is not there"
    return text.replace("\n  ", " ")


def bare(**more: Any) -> ReferenceMap:
    return from_arrays({"vx": SPEED, "delta_f": FRONT_ANGLE, "yaw_rate": YAW_RATE, **more}, "bare.npz")


def manifest_of(reference_map: ReferenceMap, config: Config, source: str, request: Request | None = None) -> Mapping[str, Any]:
    options = BuildOptions("sample", request=request)
    return build(reference_map, config, options, BuildInputs("s.npz", "0" * 64, source)).manifest


def changed(**sections: dict[str, Any]) -> Config:
    """The recommended configuration without feedback, with some keys changed."""
    data = builds.config_of("feedforward").model_dump(mode="json")
    for section, keys in sections.items():
        for key, value in keys.items():
            data[section][key] = {**data[section][key], **value} if isinstance(value, dict) else value
    return configuration.parse(data, "test")


def text_with(**sections: dict[str, Any]) -> str:
    config = changed(**sections)
    return text_of(manifest_of(solve_case(config, builds.CASE), config, "map"))


class TestMap:
    def test_one_that_was_solved(self) -> None:
        text = text_with()
        assert "The optimisation covers 20 to 120 km/h and 0.1 to 10 deg at the front wheels" in text
        assert "The map is of the optimisation (case `4ws-2`), for the car" in text
        assert "The map assumes a peak friction of 0.9." in text
        assert "| solved by the optimisation |" in text
        assert "nobody checked" not in text

    def test_chosen_breakpoints_do_not_change_what_it_covers(self) -> None:
        config = changed()
        request = Request(np.radians(2.0), None, "float", "--max-error 2deg/s")
        manifest = manifest_of(solve_case(config, builds.CASE), config, "map", request)
        assert len(manifest["map"]["speed_m_s"]) < 20
        assert "The optimisation covers 20 to 120 km/h and 0.1 to 10 deg at the front wheels" in text_of(manifest)

    def test_a_bare_one_covers_its_own_axes_and_is_not_said_to_fit(self) -> None:
        text = text_of(manifest_of(bare(), builds.config_of("feedforward"), "preset"))
        assert "The table covers 18 to 126 km/h and 0.5 to 8 deg at the front wheels" in text
        assert "**nobody checked that it fits this car**, the one of the configuration of the preset (the paper's car)" in text
        assert "at most 7 m/s^2, the most that is in the table" in text
        assert "The 0.9 is from the configuration of the preset (the paper's car)" in text
        assert "| given by the table |" in text
        assert "The optimisation covers" not in text
        assert "for the car, the tyres" not in text
        assert "solved by the optimisation" not in text

    def test_a_bare_one_with_the_configuration_of_a_file(self) -> None:
        text = text_of(manifest_of(bare(), builds.config_of("feedforward"), "mine.toml"))
        assert "**nobody checked that it fits this car**, the one of the configuration in `mine.toml`" in text
        assert "paper's" not in text

    def test_a_solved_one_with_the_configuration_of_another_file(self) -> None:
        solved = solve_case(builds.config_of("feedforward"), builds.CASE)
        text = text_of(manifest_of(solved, changed(vehicle={"mass_kg": 2500.0}), "mine.toml"))
        assert "with the one in `mine.toml`: **nobody checked that both are of the same car.**" in text
        assert "for the car, the tyres" not in text

    def test_a_stack_names_its_frictions_and_what_holds_between_and_below(self) -> None:
        text = text_of(builds.made("feedforward", layers=True).manifest)
        assert "a stack for the peak frictions 0.3, 0.5, 0.7 and 0.9." in text
        assert "values and bound are interpolated linearly, and nothing was solved there" in text
        assert "below 0.3 the values are those of 0.3, and the bound shrinks in proportion" in text
        assert "Without an estimate, and for a higher one, 0.9 is assumed." in text
        assert "The map assumes a peak friction" not in text

    def test_a_bare_stack(self) -> None:
        layers = {"friction": np.array([0.4]), "friction_yaw_rate": 0.4 * YAW_RATE[np.newaxis]}
        text = text_of(manifest_of(bare(**layers), builds.config_of("feedforward"), "preset"))
        assert "a stack for the peak frictions 0.4 and 0.9." in text
        assert "nothing was given there; below 0.4" in text
        assert "nobody checked that it fits this car" in text

    def test_where_the_values_come_from_adds_up(self) -> None:
        manifest = builds.made("pi").manifest
        rows = text_of(manifest).partition("| cells | value |\n|---|---|\n")[2].partition("\n\n")[0].splitlines()
        cells = sum(int(row.split("|")[1].replace(",", "")) for row in rows)
        assert cells == len(manifest["map"]["speed_m_s"]) * len(manifest["map"]["front_angle_rad"])

    def test_a_manifest_that_does_not_tell_the_rules(self) -> None:
        manifest = copy.deepcopy(dict(builds.made("pi").manifest))
        for key in ("rules", "rule_by_speed_and_front_angle"):
            del manifest["map"][key]
        text = text_of(manifest)
        assert "covers" not in text.partition("### Sensors")[0]
        assert "| cells |" not in text


class TestController:
    @pytest.mark.parametrize("kind", builds.KINDS)
    def test_what_is_told_of_feedback_and_map_is_of_the_kind(self, kind: str) -> None:
        text = text_of(builds.made(kind).manifest)
        assert ("This kind has no feedback" in text) is (kind in ("feedforward", "proportional"))
        assert ("where margins are told" in text) is (kind in ("tracking", "pi"))
        assert ("may pass that bound by 15 %" in text) is (kind == "tracking")
        assert ("The command of this kind does not come from the map" in text) is (kind == "proportional")

    @pytest.mark.parametrize(("kind", "told"), [("feedforward", True), ("pi", False)])
    def test_rear_angles_that_a_table_lacks_are_told_where_they_are_used(self, kind: Any, told: bool) -> None:
        text = text_of(manifest_of(bare(), builds.config_of(kind), "preset"))
        assert ("Where the table brought no rear angles" in text) is told

    def test_double_precision(self) -> None:
        manifest = builds.made("pi", precision="double").manifest
        proof = Outcome("It shows", "", Verdict.NOT_RUN, ("the proof is of single precision",), tools={"z3": "4.8"})
        text = text_of(manifest, {"proof": proof})
        assert "kind `pi`, double precision" in text
        assert "### Proof: not run\n\n- the proof is of single precision\n" in text
        assert "Z3" not in text, "no method and no tool of what was not run"

    def test_the_rate_is_the_limiters_in_every_status(self) -> None:
        text = text_with(controller={"rear_rate_max_deg_s": 25.0}, limiter={"rear_rate_max_deg_s": 30.0})
        assert "by at most 30 deg/s in every status" in text
        assert "The control law itself moves it by at most 25 deg/s." in text

    def test_the_law_goes_by_the_limiters_rate_where_that_is_lower(self) -> None:
        text = text_with(controller={"rear_rate_max_deg_s": 25.0}, limiter={"rear_rate_max_deg_s": 20.0})
        assert "by at most 20 deg/s in every status: the limiter sees to that.\n" in text
        assert "25 deg/s" not in text

    def test_without_a_limiter_only_the_law_has_a_rate(self) -> None:
        text = text_with(limiter={"rear_rate_max_deg_s": "off", "opposite_phase_max_deg": "off"})
        assert "The command moves by at most 25 deg/s where the control law acts." in text
        assert "In standby the command returns to zero by 5 deg/s." in text
        assert "the fail-safe holds the command.\n" in text, "nothing takes a held command back"
        assert "in every status" not in text

    def test_without_any_rate_the_actuators_is_the_limit(self) -> None:
        text = text_with(controller={"rear_rate_max_deg_s": "off"}, limiter={"rear_rate_max_deg_s": "off"})
        assert "The command's rate is not limited in this build" in text

    def test_the_command_is_bounded_by_the_actuator_not_by_the_limits_of_the_map(self) -> None:
        assert "The command is within +-3.5 deg" in text_with(limits={"rear_angle_max_deg": 2.0})

    def test_the_reaction_to_loss_is_of_the_configuration(self) -> None:
        text = text_with(controller={"fail_safe": {"degraded_samples_max": 0, "hold_above_km_h": 50.0, "recovery_samples": 1}})
        assert "10 ms after the last good sample, that is with the first lost one, the fail-safe acts." in text
        assert "From 50 km/h on, and where no speed was seen yet, the fail-safe holds the command, but for the limiter" in text
        assert "5 deg/s at rest and 0.5 deg/s just below 50 km/h" in text
        assert "1 good sample ends it." in text

    def test_little_margin_is_told(self) -> None:
        text = text_of(builds.made("pi").manifest)
        margins = builds.made("pi").manifest["margins"]
        assert not margins["enough"]
        assert f"**The feedback of this build has little margin from {margins['warns_from_km_h']:g} km/h" in text


MISMATCHES = {"random steps": 1, "lookup": 0}
SPREAD = {"min": 1, "mean": 1234.5, "max": 2345}
FIGURES: dict[str, dict[str, Any]] = {
    "compiles": {
        "compilations": ["clang, Cortex-M4F, c99", "gcc, c99, -O2"],
        "warnings": ["-Wall", "-Werror"],
        "needed_of_others": {"x86-64": ["sinf"], "Cortex-M4F": ["sinf"], "AArch64": []},
        "mixtures_refused": 26,
        "mixtures": 27,
        "sources_that_refuse_fast_math": 8,
    },
    "static-analysis": {"findings": {"MISRA C:2012": 50}, "deviations": {"8.9": 23}},
    "processor-in-the-loop": {
        "rows": {"random steps": 100_000, "lookup": 20_000},
        "words": {"random steps": 25, "lookup": 5},
        "statuses": {"TRACKING": 1972},
        "mismatches": {"Cortex-M4F": MISMATCHES, "Cortex-M7": MISMATCHES},
        "dynamics": {"Cortex-M4F": {"points": 500, "library_ulps": 1, "share_of_bound": 0.22222}},
    },
    "budgets": {
        "budgets": {"step_instructions_max": 1500, "task_stack_bytes_max": 320, "state_bytes_max": 128},
        "mean_over": "drawn inputs",
        "functions": {
            "controller_step": {"instructions": SPREAD, "estimated_cycles": SPREAD, "instructions_with_limiter": SPREAD},
            "cycle": {"instructions": SPREAD, "estimated_cycles": SPREAD, "instructions_bound": 2400},
        },
        "stack_bytes": {"cycle": {"watermark": 264, "bound": 272}, "limiter_step": {"watermark": 8, "bound": -1}},
        "flash_bytes": 98_030,
        "struct_bytes": {"controller": 80, "task": 152},
    },
    "law": {
        "drives": 31,
        "parameter_sets": 12,
        "samples": 52_400,
        "task_cycles": 1_800,
        "statuses": {"TRACKING": 27_444, "LIMITED": 9_196},
    },
    "proof": {
        "obligations": {"claim": 166, "invariant": 1199},
        "proved": 1364,
        "invariants": {"ars_limiter_t": ["speed is from 0 to 200", "front_angle is within +-1.5"], "ars_other_t": []},
    },
    "sanitizers": {"steps": 160_000, "look_ups": 115_000, "scenarios": 9, "faults": 28, "trap_build": "Cortex-M4F"},
    "fuzzing": {"can": {"inputs": 50_000, "seeds": 18, "corpus": 171, "edges": 415}},
}
"""As the checks give them, fewer of each."""

ROWS = {
    "compiles": ("| mixtures of builds refused | 26 of 27 |", "| needed of a library for x86-64; Cortex-M4F | `sinf` |"),
    "static-analysis": ("| MISRA C:2012 | 50 |", "| 8.9 | 23 |"),
    "processor-in-the-loop": ("| random steps | 100,000 | 25 | 1 | 1 |", "| TRACKING | 1,972 |", "| Cortex-M4F | 500 | 22% |"),
    "budgets": (
        "| controller_step, its limiter apart | 2,345 | 1,234 | - | 1,500 |",
        "| controller_step, limiter included | 2,345 | 1,234 | 2,345 | - |",
        "| cycle: both frames received, and the task | 2,345 (bound 2,400) | 1,234 | 2,345 | - |",
        "| cycle | 264 B | 272 B | 320 B |",
        "| limiter_step | 8 B | none | - |",
        "| RAM of one controller | 80 B | 128 B |",
        "| flash of all objects, tables and default parameters included | 98,030 B | - |",
    ),
    "law": ("| drives | 31 |", "| cycles of the task, frames in and frame out | 1,800 |", "| TRACKING | 27,444 |"),
    "proof": (
        "| invariant | 1,199 |",
        "| **proved** | 1,364 of 1,365 |",
        "| `ars_limiter_t` | speed is from 0 to 200; front_angle is within +-1.5 |",
    ),
    "sanitizers": (
        "| faults of the catalogue | 28 |",
        "| steps of the drives | 160,000 |",
        "| trap build, run on | Cortex-M4F |",
    ),
    "fuzzing": ("| can | 50,000 | 18 | 171 | 415 |",),
}

METHODS = {
    "compiles": "a warning is an error",
    "static-analysis": "Reference is\n`deviations.md`",
    "processor-in-the-loop": "have to have the same bits",
    "budgets": "from call to return",
    "law": "written a second time",
    "proof": "becomes an obligation",
    "sanitizers": "AddressSanitizer",
    "fuzzing": "changed at random",
}


def section_of(name: str, figures: Mapping[str, Any], verdict: Verdict = Verdict.PASSED, **more: Any) -> str:
    """What the manual tells of a check with some figures."""
    outcome = Outcome("It shows", "one", verdict, figures=figures, **more)
    text = text_of(builds.made("pi").manifest, {name: outcome})
    return text.partition("Every figure is in")[2].partition("## What is not shown")[0]


class TestResults:
    def test_every_check_is_known(self) -> None:
        names = {check.name for check in CHECKS}
        assert names == FIGURES.keys() == ROWS.keys() == METHODS.keys() == manual.TABLES.keys()

    @pytest.mark.parametrize("name", FIGURES)
    def test_a_check_has_its_method_and_its_results(self, name: str) -> None:
        section = section_of(name, FIGURES[name])
        assert METHODS[name] in section
        for row in ROWS[name]:
            assert f"\n{row}\n" in section

    @pytest.mark.parametrize("name", FIGURES)
    def test_every_row_of_a_table_has_as_many_cells_as_its_heading(self, name: str) -> None:
        for table in section_of(name, FIGURES[name]).split("\n\n"):
            lines = [line for line in table.splitlines() if line.startswith("|")]
            assert len({line.count("|") for line in lines}) <= 1
            assert len(lines) != 2, "a table without a row"

    @pytest.mark.parametrize("name", FIGURES)
    def test_a_check_that_was_not_run_has_neither(self, name: str) -> None:
        section = section_of(name, {}, Verdict.NOT_RUN, findings=("left out by --quick",))
        assert METHODS[name] not in section
        assert "|" not in section
        assert section.endswith(": not run\n\n- left out by --quick\n\n")

    @pytest.mark.parametrize("name", FIGURES)
    def test_figures_that_are_missing_give_no_table_and_no_error(self, name: str) -> None:
        for key in FIGURES[name]:
            section_of(name, {each: value for each, value in FIGURES[name].items() if each != key})
        assert "|" not in section_of(name, {})

    @pytest.mark.parametrize("name", FIGURES)
    @pytest.mark.parametrize("other", [None, 1.5, [[]], {"a": None}], ids=repr)
    def test_figures_of_another_shape_give_no_table_and_no_error(self, name: str, other: Any) -> None:
        assert "|" not in section_of(name, dict.fromkeys(FIGURES[name], other))

    def test_the_figures_of_the_check_of_the_budgets_itself(self, of_kind: Callable[..., Outcome]) -> None:
        outcome = of_kind("pi")
        section = section_of("budgets", outcome.figures)
        assert set(manual.BUDGETS.values()) <= outcome.figures["budgets"].keys()
        largest, budget = outcome.figures["functions"]["limiter_step"]["instructions"]["max"], outcome.figures["budgets"]
        assert f"\n| limiter_step | {largest:,} |" in section
        assert f"| {budget['limiter_instructions_max']:,} |\n" in section
        assert f"| {budget['task_instructions_max']:,} |\n" in section
        assert f" B | {budget['state_bytes_max']:,} B |\n" in section
        assert section.count("|---|\n") == 3, "instructions, stack and memory"

    @pytest.mark.parametrize("verdict", Verdict)
    def test_that_the_law_was_not_compared_is_told(self, verdict: Verdict) -> None:
        text = text_of(builds.made("pi").manifest, {"law": Outcome("It shows", "one", verdict)})
        assert ("\n- That each command is the one of the control law." in text) == (verdict is Verdict.NOT_RUN)

    def test_tools_name_themselves_once(self) -> None:
        tools = {
            "gcc": "gcc (Debian 12.2.0-14) 12.2.0",
            "cppcheck": "2.22.0",
            "C compiler of this machine": "cc (Debian) 12.2.0",
        }
        section = section_of("budgets", FIGURES["budgets"], tools=tools)
        assert (
            "\nTools: gcc (Debian 12.2.0-14) 12.2.0, Cppcheck 2.22.0, cc (Debian) 12.2.0 as C compiler of this machine.\n"
            in section
        )

    def test_a_bar_in_a_figure_does_not_break_its_table(self) -> None:
        assert "\n| a \\| b | 1 |\n" in section_of("static-analysis", {"deviations": {"a | b": 1}})


def test_the_digest_of_the_manifest_is_whole() -> None:
    assert f"SHA-256 of its `manifest.json`: `{DIGEST}`." in text_of(builds.made("pi").manifest)
