"""A program that calls a whole build with extreme and random arguments under AddressSanitizer and UBSan.

An out-of-bounds access may still return the right number, so no comparison of results detects it.
"""

import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

from codegen.emit.can_view import task_name
from tests.sil.case import Case

FLAGS = ("-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-DARS_SECTION_CALIBRATION=")
"""The sanitizer detects an overrun of an object only if the object is in no named section."""

PROGRAM = """
#include "ars_can.h"
#include "ars_controller.h"
#include "ars_dynamics.h"
#include "ars_e2e.h"
#include "ars_limiter.h"
#include "ars_map.h"
#include "ars_task.h"
#if HAS_MODEL
#include "ars_reference_model.h"
#endif
#include <float.h>
#include <math.h>
#include <stdlib.h>

static const REAL speeds[] = { SPEEDS };
static const REAL angles[] = { ANGLES };
static const REAL extremes[] = {
    0, -0.0f, 1, -1, 64, -64, 1000, FLT_MIN, -FLT_MIN, FLT_MAX, -FLT_MAX, 1e-40f, INFINITY, -INFINITY, NAN
};
#define COUNT(array) ((uint32_t)(sizeof(array) / sizeof((array)[0])))

static uint32_t state = 1u;
static volatile REAL sink;

static uint32_t number(uint32_t below)
{
    state = (state * 1664525u) + 1013904223u;
    return (state >> 8) % below;
}

/* Mostly plausible; sometimes an extreme or a limit of the map. */
static REAL any(REAL most)
{
    switch (number(12u)) {
    case 0u: return extremes[number(COUNT(extremes))];
    case 1u: return speeds[number(COUNT(speeds))];
    case 2u: return ((number(2u) == 0u) ? 1 : -1) * angles[number(COUNT(angles))];
    case 3u: return 0;
    default: return most * ((REAL)number(20001u) - 10000) / 10000;
    }
}

static void maps(void)
{
    for (uint32_t k = 0u; k < 60000u; k++) {
        const REAL speed = any(120), angle = any(0.8f), friction = any(1);
        sink = ars_map_yaw_rate(speed, angle) + ars_map_yaw_rate_on_road(speed, -angle, friction);
#if HAS_MODEL
        sink = ars_map_reference(speed, angle, friction).rear_angle;
#endif
    }
}

/* Each object is a separate block, so the sanitizer detects an access one byte beyond it. */
static void controllers(const ars_parameters_t *defaults)
{
    ars_parameters_t open = *defaults; /* every value in range is trusted, so the law receives all of them */
    open.inputs.speed_step = 200;
    open.inputs.front_angle_step = 3;
    open.inputs.yaw_rate_step = 40;
    open.inputs.yaw_rate_frozen = 20;
    const ars_parameters_t *parameters = &open;
    ars_controller_t *self = malloc(sizeof(*self));
    ars_limiter_t *limiter = malloc(sizeof(*limiter));
    for (uint32_t k = 0u; k < 8000u; k++) {
        if ((k % 200u) == 0u) {
            parameters = ((k % 400u) == 0u) ? &open : defaults;
            ars_controller_init(self, any(0.08f));
            ars_limiter_init(limiter, any(0.08f));
        }
        ars_measurement_t sample = {
            (REAL)(5u + number(107u)), 0.01f * ((REAL)number(21u) - 10), 0.02f * ((REAL)number(21u) - 10), NAN, NAN, false
        };
        if (number(10u) == 0u) {
            sample = (ars_measurement_t){ any(120), any(0.8f), any(2), any(0.1f), any(1), number(2u) == 0u };
        }
        if ((k % 200u) == 100u) {
            sample.speed = parameters->inputs.speed_max;
        }
        const ars_limiter_input_t input = { any(120), any(0.8f), any(0.1f) };
        sink = ars_controller_step(self, parameters, &sample).rear_angle;
        sink = ars_limiter_step(limiter, &parameters->limiter, &input);
    }
    free(self);
    free(limiter);
}

static void frames(const ars_parameters_t *parameters)
{
    uint8_t *data = malloc(8u), counter = 0u;
    ars_task_t *task = malloc(sizeof(*task));
    ars_task_init(task, parameters);
    for (uint32_t k = 0u; k < 4000u; k++) {
        ars_vehicle_motion_t motion = { any(60), any(0.5f), any(2) };
        ars_vehicle_conditions_t conditions = { any(0.1f), any(1), number(2u) == 0u };
        ars_rear_steer_command_t command = { any(0.1f), any(2), (uint8_t)number(16u), (uint16_t)number(65536u) };
        ars_can_pack_rear_steer_command(&command, data);
        ars_can_unpack_rear_steer_command(data, &command);
        ars_can_pack_vehicle_motion(&motion, data);
        ars_e2e_protect((uint16_t)ARS_CAN_DATA_ID_VEHICLE_MOTION, &counter, data);
        ars_task_on_can_frame(task, (uint32_t)ARS_CAN_ID_VEHICLE_MOTION, data, (uint8_t)(8u - (number(50u) == 0u)));
        counter = (uint8_t)((counter + 14u) % 15u);
        ars_can_pack_vehicle_conditions(&conditions, data);
        ars_e2e_protect((uint16_t)ARS_CAN_DATA_ID_VEHICLE_CONDITIONS, &counter, data);
        data[number(8u)] ^= (uint8_t)(number(30u) == 0u);
        ars_task_on_can_frame(task, (uint32_t)ARS_CAN_ID_VEHICLE_CONDITIONS, data, 8u);
        sink = (REAL)TASK(task, data);
    }
    free(data);
    free(task);
}

static void cars(void)
{
    for (uint32_t k = 0u; k < 300u; k++) {
        const ars_dynamics_state_t x = { any(0.3f), any(1) };
        const ars_dynamics_input_t u = { any(50), any(0.5f), any(0.06f), any(1) };
        sink = ars_dynamics_linear(&x, &u).yaw_rate + ars_dynamics_magic_formula(&x, &u).yaw_rate;
        sink = ars_dynamics_linear_jacobian(&x, &u).state[1][1] + ars_dynamics_magic_formula_jacobian(&x, &u).input[1][3];
    }
#if HAS_MODEL
    ars_reference_model_t *model = malloc(sizeof(*model));
    ars_reference_model_start(model, 20, 0, 0);
    for (uint32_t k = 0u; k < 4000u; k++) {
        const ars_reference_model_input_t input = { any(120), any(0.8f), any(0.06f), any(1) };
        ars_reference_model_step(model, &input);
        if ((k % 100u) == 0u) {
            ars_reference_model_start(model, any(120), any(2), any(0.06f));
        }
    }
    for (uint32_t k = 0u; k < 4u; k++) { /* a damaged state */
        const ars_reference_model_input_t input = { 20, 0, 0, 1 };
        const float bad[] = { NAN, INFINITY, 1e30f, -1e30f };
        *model = (ars_reference_model_t){ .sideslip_angle = bad[k] };
        ars_reference_model_step(model, &input);
        sink = model->sideslip_angle;
    }
    free(model);
#endif
}

int main(void)
{
    static ars_parameters_t parameters;
    parameters = ars_parameters_default;
    maps();
    controllers(&parameters);
    frames(&parameters);
    cars();
    return ars_selftest() ? 0 : 1;
}
"""


def check_memory(case: Case) -> None:
    """Check that the program ends normally: no out-of-bounds access, no undefined behaviour, and the self-test passes."""
    root = case.tree.root / "memory"
    if "memory" not in case.kept:
        case.kept["memory"] = _prepare(case, root)
    objects, program = dict(case.kept["memory"]), root / f"program-{os.getpid()}"
    if case.mutated is not None:
        changed = root / f"mutant-{os.getpid()}.c"
        changed.write_text(case.mutated.source, encoding="ascii")
        objects[case.mutated.path] = changed.with_suffix(".o")
        case.compiler.compile(case.tree.root, str(changed), changed.with_suffix(".o"), FLAGS)
    case.compiler.link_program([*objects.values(), root / "main.o"], program, FLAGS)
    done = subprocess.run([program], capture_output=True, text=True, errors="replace", timeout=600, check=False)
    first = next((line for line in done.stderr.splitlines() if "ERROR" in line or "runtime error" in line), "")
    assert done.returncode == 0, first or f"it ended with {done.returncode}"


def _prepare(case: Case, root: Path) -> dict[str, Path]:
    """Compile the unmodified units and the program."""
    root.mkdir(exist_ok=True)
    (root / "main.c").write_text(_program(case), encoding="ascii")
    case.compiler.compile(case.tree.root, "memory/main.c", root / "main.o", ("-std=gnu99", *FLAGS))
    objects = {path: root / f"{Path(path).name}.o" for path in case.tree.units}
    for path, target in objects.items():
        case.compiler.compile(case.tree.root, path, target, FLAGS)
    return objects


def _program(case: Case) -> str:
    real, total, period = case.built.real, case.built.total, case.built.software.config.controller.sampling_time_s
    words = {
        "SPEEDS": _listed(total.speed, real),
        "ANGLES": _listed(total.front_angle, real),
        "HAS_MODEL": str(int("include/ars_reference_model.h" in case.built.folder.files)),
        "TASK": f"ars_{task_name(period)}",
        "REAL": "float" if real is np.float32 else "double",
    }
    return "".join(f"#define {word} {value}\n" for word, value in words.items()) + PROGRAM


def _listed(breakpoints: Any, real: Any) -> str:
    """Return the ends and some other breakpoints, each with its neighbours."""
    some = np.unique(np.concatenate([breakpoints[:3], breakpoints[3:-3:20], breakpoints[-3:]]).astype(real))
    near = np.concatenate([np.nextafter(some, real(-np.inf)), some, np.nextafter(some, real(np.inf))])
    return ", ".join(float(value).hex() for value in near)
