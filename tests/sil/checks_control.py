"""What the paper's control law promises, in the words of its description; `suite` compares each sample with the second
implementation. Each check takes a build of kind "pi" and raises AssertionError if the build fails it.

Errors are reference minus measured yaw rate, rad/s.
"""

import math
from collections.abc import Iterable

from codegen.sil.software import Command, Controller, Status
from tests.builds import CONFIG, Built

PERIOD = CONFIG.controller.sampling_time_s
RATE_LIMIT = math.radians(25.0)
RUNNING = (Status.TRACKING, Status.LIMITED)


def run(built: Built, controller: Controller, errors: Iterable[float]) -> list[Command]:
    """Take a sample in the same turn for each error; nobody measures the rear angle."""
    return [controller.step(built.turn(error)) for error in errors]


def angles(commands: Iterable[Command]) -> list[float]:
    """Return the rear angles that were asked for."""
    return [command.rear_angle for command in commands]


def check_anti_windup(built: Built) -> None:
    """An error of +0.2 rad/s for 10 s takes the command to the limit, exactly; with -0.05 it leaves it in one sample, whatever
    bounds its rate."""
    gains = CONFIG.controller
    for sign in (1.0, -1.0):
        for rate in (1000.0, RATE_LIMIT):
            controller = built.software.controller(0.0, built.software.parameters(rear_rate_max=rate))
            *_, before = run(built, controller, [0.2 * sign] * round(10.0 / PERIOD))
            assert before.rear_angle == -sign * controller.parameters.rear_angle_max
            assert before.status is Status.LIMITED
            (after,) = run(built, controller, [-0.05 * sign])
            # Back by one step of the law: the change of the proportional part and one step of the integral.
            expected = gains.proportional_gain_s * 0.25 + gains.integral_gain * PERIOD * 0.05
            assert abs(sign * (after.rear_angle - before.rear_angle) - expected) < 10.0 * built.eps
            assert after.status is Status.TRACKING
