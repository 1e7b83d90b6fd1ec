"""A kind of controller that is added to the tables is built and driven. tests/evidence/kinds also verifies it."""

from __future__ import annotations

from tests.additions.copy import ROOT, Copy

LAW_C = """/* Control law "share": a share of the front angle, smoothed, at the rate limit. */

{{ helpers.in_direction() }}

{{ P }}_SECTION_CODE void {{ p }}_law_init({{ p }}_law_t *self, {{ real }} rear_angle)
{
    self->smoothed = rear_angle;
    self->is_limited = false;
}

{{ P }}_SECTION_CODE {{ p }}_law_output_t {{ p }}_law_step(
    {{ p }}_law_t *self, const {{ p }}_parameters_t *parameters, const {{ p }}_measurement_t *sample, {{ p }}_law_phase_t phase,
    {{ real }} friction, {{ real }} rear_angle, {{ real }} yaw_rate_error)
{
    const {{ real }} command_step_max = command_step(parameters);
    {{ real }} bounded_demand;
    {{ p }}_law_output_t output;

    (void)yaw_rate_error;
    if (phase == {{ P }}_LAW_STARTS) {
        self->smoothed = rear_angle;
    }
    self->smoothed += {{ quarter }} * ((parameters->front_share * sample->front_angle) - self->smoothed);
    bounded_demand = bounded(self->smoothed, parameters->rear_angle_max);
    output.rear_angle = clamp(bounded_demand, rear_angle - command_step_max, rear_angle + command_step_max);
    output.yaw_rate_reference
        = in_direction({{ p }}_map_yaw_rate_on_road(magnitude(sample->speed), sample->front_angle, friction), sample->speed);
    self->is_limited = (self->smoothed > output.rear_angle) || (self->smoothed < output.rear_angle);
    return output;
}
"""
LAW = """        Law(
            kind="share",
            title="a share of the front angle",
            parameters=lambda config: (Parameter("front_share", 0.2, NONE, "share of the front angle", 0.0, 0.5),),
            state=(Field("real", "smoothed", RAD, "smoothed rear angle", 2.0),),
        ),
"""
SECOND = """class SecondShare(SecondController):
    smoothed: Any = 0.0

    def start(self, m: Measurement) -> None:
        self.smoothed = self.angle

    def law(self, m: Measurement) -> tuple[Any, bool]:
        self.smoothed = self.smoothed + self.real(0.25) * (self.parameter("front_share") * m.front_angle - self.smoothed)
        bound = self.parameter("rear_angle_max")
        self.angle = self.reachable(clip(self.smoothed, -bound, bound))
        return self.map_yaw_rate(m), bool(self.angle != self.smoothed)


"""
MAP = ROOT / "generated" / "4ws2-paper.npz"
BUILD = """
import sys
from pathlib import Path

from codegen.configuration import parse, preset
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.map_file import map as npz

data = preset("recommended").model_dump()
data["controller"]["kind"] = "share"
data["plant"]["backlash_deg"] = 0.0  # the wheels follow the command
config = parse(data, "test")
reference_map = npz.load(Path(sys.argv[1]))
folder = build(reference_map, config, BuildOptions("share"), BuildInputs("map.npz", "0" * 64, "car.toml"))
"""
CHECK = """
from codegen.importing.toml_edit import whole
from codegen.sil.closed_loop import ClosedLoop
from codegen.sil.software import RECORD_COLUMNS, compile_build
from hil_sim.scenario_files import find

software = compile_build(folder.files, folder.manifest)
assert software.selftest()

run = ClosedLoop(software).run(find("step-steer").inputs(config))
rear, front = (run[-1, RECORD_COLUMNS.index(f"{name}_rad")] for name in ("rear_angle", "front_angle"))
assert abs(rear - 0.2 * front) < 1e-4 and abs(front) > 0.01
Path("ars.toml").write_text(whole(config.replace({"grid.speed_points": 11, "grid.front_angle_points": 10}), "test"))
"""


def add_kind(tree: Copy) -> None:
    """Add the kind to a copy of the tree."""
    tree.add("templates/law/share/law.c.j2", LAW_C)
    tree.replace("codegen/configuration/controller.py", '"proportional"]\n', '"proportional", "share"]\n')
    budget = '    "proportional": {"step_instructions_max": 750, "task_instructions_max": 1_890},\n'
    tree.after("codegen/configuration/budgets.py", budget, budget.replace("proportional", "share"))
    tree.replace(
        "codegen/emit/laws.py",
        '        Law(\n            kind="proportional",\n',
        LAW + '        Law(\n            kind="proportional",\n',
    )
    tree.replace("tests/oracle/kinds.py", "SECOND: Mapping", SECOND + "SECOND: Mapping")
    tree.after(
        "tests/oracle/kinds.py",
        '    "proportional": SecondProportional,\n',
        '    "share": SecondShare,\n',
    )


def test_a_kind_touches_at_most_five_files(tree: Copy) -> None:
    add_kind(tree)
    tree.run("-c", BUILD + CHECK, str(MAP))
    tree.commands(
        "solve --config ars.toml --case 4ws-2 -o new.npz",
        "build --map new.npz -o new",
        "check new",
        "sil --build new",
        "hil --build new --bus virtual:bench --ecu cffi --lock-step",
    )
    assert len(tree.touched) <= 5
