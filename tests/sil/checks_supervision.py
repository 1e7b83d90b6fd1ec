"""Checks of inputs, standby and fail-safe. Each takes a build of any kind and raises AssertionError if the build fails it."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.sil.software import Measurement, Status
from tests.builds import CONFIG, FRONT_ANGLE, SPEED, Built

PERIOD = CONFIG.controller.sampling_time_s
RUNNING = (Status.TRACKING, Status.LIMITED)
LOST = Measurement(math.nan, math.nan, math.nan)
"""Nothing arrives, not even the speed."""

STRANGE = Measurement(SPEED, 0.0, 2.0)
"""A yaw rate that neither speed nor steering explains."""

NEEDED = {"speed": "speed_max", "front_angle": "front_angle_max", "yaw_rate": "yaw_rate_max"}
OPTIONAL = {"rear_angle": "rear_angle_input_max", "friction": "friction_max"}


def lost_at(speed: float) -> Measurement:
    """The yaw rate is lost; the speed still arrives."""
    return Measurement(speed, 0.0, math.nan)


def check_inputs(built: Built) -> None:
    """Each field is taken up to its limit and refused one unit in the last place beyond, on either side; NaN where a value is
    needed and infinity everywhere are refused; NaN where none is needed is not."""
    # Without a check of plausibility, which would see a yaw rate at its limit first.
    parameters = built.software.parameters(yaw_rate_tolerance=20.0)
    good = built.turn(0.01, rear_angle=0.01, friction=0.8)

    def taken(**change: Any) -> bool:
        controller = built.software.controller(0.02, parameters)
        controller.step(good)
        return controller.step(replace(good, **change)).status is not Status.DEGRADED

    for field, limit_name in (NEEDED | OPTIONAL).items():
        limit = float(getattr(parameters, limit_name))
        low = 0.0 if field == "friction" else -limit
        assert taken(**{field: limit}), field
        assert taken(**{field: low}), field
        assert not taken(**{field: built.next(limit, math.inf)}), field
        assert not taken(**{field: built.next(low, -math.inf)}), field
        assert not taken(**{field: math.inf}), field
        assert not taken(**{field: -math.inf}), field
        assert taken(**{field: math.nan}) == (field in OPTIONAL), field


def check_plausibility_limit(built: Built) -> None:
    """A yaw rate is explained by speed and steering between none and the kinematic turn, give or take what the rear wheels
    can add and the tolerance; forward and in reverse, on both sides."""
    parameters = built.software.parameters(implausible_samples_max=1)
    wheelbase, tolerance = CONFIG.vehicle.wheelbase, math.radians(CONFIG.controller.inputs.yaw_rate_tolerance_deg_s)
    for speed in (SPEED, -SPEED, 1.0, 0.0):
        for front in (FRONT_ANGLE, -FRONT_ANGLE, 0.0):
            turn = speed * front / wheelbase
            margin = abs(speed) * CONFIG.rear_actuator.angle_max / wheelbase + tolerance
            for limit in (max(turn, 0.0) + margin, min(turn, 0.0) - margin):
                for share, believed in ((1.0 - 1e-5, True), (1.0 + 1e-5, False)):
                    command = built.software.controller(0.0, parameters).step(Measurement(speed, front, limit * share))
                    assert (command.status is not Status.DEGRADED) == believed, (speed, front, limit)


def check_signalling_nan(built: Built) -> None:
    """A signalling NaN is rejected like any other; a Python float cannot carry one."""
    software, bits = built.software, {4: 0x7F800001, 8: (0x7FF0 << 48) + 1}
    for field in NEEDED:
        controller, sample = software.controller(), software.new("measurement")
        sample[0] = (15.0, 0.0, 0.0, math.nan, math.nan, False)
        offset, size = software.ffi.offsetof(software.ffi.typeof(sample).item, field), np.dtype(software.real).itemsize
        software.ffi.memmove(software.ffi.cast("char *", sample) + offset, bits[size].to_bytes(size, "little"), size)
        command = software.function("controller_step")(controller.state, controller.parameters, sample)
        assert command.status == Status.DEGRADED, field


def check_fail_safe_at_the_hold_speed(built: Built) -> None:
    """Held from that very speed on, whatever the kind; below it, ramped."""
    for below in (False, True):
        controller = built.software.controller(0.001)
        hold_speed = float(controller.parameters.hold_speed)
        speed = built.next(hold_speed, 0.0) if below else hold_speed
        controller.step(built.turn(speed=speed))
        found = controller.run([lost_at(speed)] * (controller.parameters.degraded_samples_max + 4))[-4:]
        assert {command.status for command in found} == {Status.FAIL_SAFE}
        angles_found = [command.rear_angle for command in found]
        assert angles_found[0] != 0.0
        assert (angles_found[-1] != angles_found[0]) == below


def check_gaps(built: Built) -> None:
    """Without a sample a law goes on as if the last one came again; only the reference model, which moves, makes a difference.
    A gap of which every second sample is lost is no fault, one that loses more than it gets ends in the fail-safe."""
    good = built.turn(0.01)
    gap = [LOST] * built.software.parameters().degraded_samples_max
    for start in (0.03, -0.01):
        with_gap, without = built.software.controller(start), built.software.controller(start)
        found, wanted = with_gap.run([good] * 3 + gap + [good]), without.run([good] * (4 + len(gap)))
        assert {command.status for command in found[3:-1]} == {Status.DEGRADED} and found[-1].status in RUNNING
        if built.software.config.controller.kind != "tracking":
            assert [command.rear_angle for command in found] == [command.rear_angle for command in wanted]
    for wrong, most in ((LOST, len(gap)), (STRANGE, built.software.parameters().implausible_samples_max)):
        every_second = built.software.controller(0.0).run([good, wrong] * (3 * most))
        assert {command.status for command in every_second[1::2]} == {Status.DEGRADED}
        assert Status.FAIL_SAFE not in {command.status for command in every_second}
        mostly = built.software.controller(0.0).run([good] + [good, wrong, wrong, wrong] * most)
        first = [command.status for command in mostly].index(Status.FAIL_SAFE)
        assert 1 + 2 * most <= first + 1 <= 1 + 2 * most + 4, "of four samples three count one more, and one counts one less"


def check_recovery(built: Built) -> None:
    """So many good samples in a row, and not one less, end the fail-safe."""
    good, needed = built.turn(0.01), built.software.parameters().recovery_samples
    controller = built.software.controller(0.03)
    controller.run([good] * 5)
    while controller.step(LOST).status is not Status.FAIL_SAFE:
        pass
    for bad in (LOST, None):
        assert {command.status for command in controller.run([good] * (needed - 1))} == {Status.FAIL_SAFE}
        assert controller.step(bad or good).status in ((Status.FAIL_SAFE,) if bad else RUNNING)
    controller.run([good] * (needed - 1))
    assert controller.state.good_samples == 0, "counted in the fail-safe alone"


def check_standby(built: Built) -> None:
    """Control starts at the enabling speed and ends below the disabling one; between, and only there, it stays what it was.
    Reverse is standby. In standby the angle goes to zero at its rate."""
    parameters = built.software.parameters()
    enable, disable = float(parameters.enable_speed), float(parameters.disable_speed)
    between = 0.5 * (enable + disable)
    drive = [
        *((0.0, False), (between, False), (built.next(enable, 0.0), False), (enable, True), (SPEED, True)),
        *((between, True), (disable, True), (built.next(disable, 0.0), False), (between, False), (enable, True)),
        *((0.0, False), (-0.0, False), (-1.0, False), (-SPEED, False), (-60.0, False), (between, False), (SPEED, True)),
    ]
    controller = built.software.controller()
    for speed, controlled in drive:
        command = controller.step(Measurement(speed, 0.0, 0.0))
        assert (command.status in RUNNING) == controlled, speed
        assert controlled or command.status is Status.STANDBY
    controller, step = built.software.controller(0.05), math.radians(CONFIG.controller.standby_rate_deg_s) * PERIOD
    commands = controller.run([Measurement(disable - 0.1, 0.1, 0.0)] * 80)
    path = np.array([0.05, *(command.rear_angle for command in commands)])
    # The start and each command are rounded at 0.05 rad: an eighth of a unit in the last place at 1.
    assert np.abs(-np.diff(path)[path[1:] > 0.0] - step).max() < 0.3 * built.eps
    assert (path >= 0.0).all() and path[-1] == 0.0


def random_measurements(built: Built, rng: np.random.Generator, count: int) -> Any:
    """A C array of measurements, each field at random plausible, at a limit, special, or any bit pattern."""
    software = built.software
    samples = software.ffi.new(f"{software.prefix}_measurement_t[]", count)
    real: Any = software.real
    size = np.dtype(real).itemsize
    stride = software.ffi.sizeof(samples) // count
    rest = stride - 5 * size - 1
    layout = np.dtype([("bits", f"u{size}", 5), ("inhibit", np.uint8), ("rest", np.uint8, rest)])
    view: npt.NDArray[Any] = np.frombuffer(software.ffi.buffer(samples), dtype=layout)
    parameters = software.parameters()
    limits = np.array([getattr(parameters, limit) for limit in (NEEDED | OPTIONAL).values()])
    special = np.array([0.0, -0.0, np.nan, np.inf, -np.inf, 1e-40, 1e30, -1e30])
    kinds = [
        rng.uniform(-0.5, 0.5, (count, 5)) * limits,
        np.abs(rng.normal(0.0, 0.15, (count, 5))) * limits,
        rng.choice([-1.0, 1.0], (count, 5)) * limits,
        rng.choice(special, (count, 5)),
        np.frombuffer(rng.bytes(count * 5 * size), dtype=real).reshape(count, 5),
    ]
    weights = np.repeat(rng.choice([0, 1, 2], count // 50 + 1, p=[0.3, 0.4, 0.3]), 50)[:count]  # calm, rough and wild spells
    chances = np.array([[0.0, 1.0, 0.0, 0.0, 0.0], [0.1, 0.88, 0.005, 0.01, 0.005], [0.2, 0.2, 0.2, 0.2, 0.2]])
    pick = (rng.random((count, 5, 1)) > np.cumsum(chances, axis=1)[weights][:, np.newaxis, :]).sum(axis=2).clip(0, 4)
    view["bits"] = np.choose(pick, [kind.astype(real).view(f"u{size}") for kind in kinds])  # a copied NaN may turn quiet
    view["inhibit"] = rng.random(count) < 0.1
    return samples
