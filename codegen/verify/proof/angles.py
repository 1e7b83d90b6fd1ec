"""What is claimed of the rear angle: by the limiter, as ars_limiter.h has it, and of the command in each status.

Bounds are computed as in single precision, sums and quotients in the order that the headers' words suggest. Times are those of
the build's configuration.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from codegen.verify.proof.calls import Call, Claims
from codegen.verify.proof.floats import FORMATS
from codegen.verify.proof.invariants import Path
from codegen.verify.proof.source import Function, ParsedProgram
from codegen.verify.proof.terms import Pool, Term

INITIAL_ANGLE_MAX = 1.0
"""rad: beyond, the limiter starts from zero."""


@dataclass(frozen=True)
class Limiter:
    """A limiter's state and parameters in a call: where they lie below `self` and `parameters`."""

    call: Call
    inner: Path = ()

    @property
    def pool(self) -> Pool:
        return self.call.pool

    def parameter(self, *path: str | int) -> Term:
        return self.call.before("parameters", (*self.inner, *path))

    def before(self, *path: str) -> Term:
        return self.call.before("self", (*self.inner, *path))

    def behind(self, *path: str) -> Term:
        return self.call.behind("self", (*self.inner, *path))

    def step(self, sampling_time: float) -> Term:
        """rad in a step."""
        return over(self.pool, self.parameter("rear_rate_max"), sampling_time)

    @property
    def opposite_phase_bound(self) -> Term:
        """rad against the front wheels: linear between the breakpoints, beyond them held."""
        pool, speed = self.pool, self.behind("speed")
        points = self._points()
        bound = self.parameter("opposite_phase_max", points - 1)
        for k in range(points - 1, 0, -1):
            at, at_next = (self.parameter("opposite_phase_speed", each) for each in (k - 1, k))
            value, value_next = (self.parameter("opposite_phase_max", each) for each in (k - 1, k))
            share = pool.apply("fdiv", speed.sort, pool.sub(speed, at), pool.sub(at_next, at))
            between = pool.add(value, pool.apply("fmul", speed.sort, share, pool.sub(value_next, value)))
            bound = pool.ite(pool.flt(speed, at_next), pool.ite(pool.flt(at, speed), between, value), bound)
        return bound

    def _points(self) -> int:
        points = 1
        while True:
            try:
                self.parameter("opposite_phase_speed", points)
            except LookupError:
                return points
            points += 1

    @property
    def range(self) -> tuple[Term, Term]:
        """rad, lowest and highest: in phase with the front wheels free from some front angle on."""
        pool, front, bound = self.pool, self.behind("front_angle"), self.opposite_phase_bound
        zero, one = (pool.real(each, -front.sort) for each in (0.0, 1.0))
        share = pool.apply("fdiv", front.sort, pool.magnitude(front), self.parameter("in_phase_from_front_angle"))
        share = pool.ite(pool.flt(share, one), share, one)
        free = pool.sub(self.parameter("rear_angle_max"), bound)
        in_phase = pool.add(bound, pool.apply("fmul", front.sort, share, free))
        low = pool.ite(pool.flt(front, zero), pool.neg(in_phase), pool.neg(bound))
        return low, pool.ite(pool.flt(zero, front), in_phase, bound)

    def lets_through(self, angle: Term) -> Term:
        """Whether an angle is within all bounds but that of the rate; any is that is within rear_angle_max, without a speed."""
        pool, (low, high) = self.pool, self.range
        inside = pool.and_(pool.fle(low, angle), pool.fle(angle, high))
        largest = pool.fle(pool.magnitude(angle), self.parameter("rear_angle_max"))
        return pool.and_(largest, pool.or_(pool.not_(self.behind("speed_known")), inside))


def over(pool: Pool, rate: Term, sampling_time: float) -> Term:
    """What a rate comes to in a step."""
    return pool.apply("fmul", rate.sort, rate, pool.real(FORMATS[-rate.sort].round(sampling_time), -rate.sort))


def implied(pool: Pool, *terms: Term) -> Term:
    """The last one where all others hold."""
    *conditions, goal = terms
    return pool.or_(*(pool.not_(each) for each in conditions), goal)


def moved(limiter: Limiter, angle: Term, sampling_time: float) -> Iterator[tuple[str, Term]]:
    """As far as the limiter's rate allows, or to the bound that it was beyond."""
    pool, before, largest = limiter.pool, limiter.before("rear_angle"), limiter.parameter("rear_angle_max")
    step = limiter.step(sampling_time)
    rises = pool.fle(angle, pool.add(before, step))
    falls = pool.fle(pool.sub(before, step), angle)
    yield "it rises by at most rear_rate_max, or to -rear_angle_max", pool.or_(rises, pool.feq(angle, pool.neg(largest)))
    yield "it falls by at most rear_rate_max, or to rear_angle_max", pool.or_(falls, pool.feq(angle, largest))


def limited(sampling_time: float) -> Claims:
    """Of the limiter's step."""

    def limiter_step(call: Call) -> Iterator[tuple[str, Term]]:
        limiter, pool, angle = Limiter(call), call.pool, call.results[()][1]
        yield (
            "|rear angle| is at most rear_angle_max",
            pool.fle(pool.magnitude(angle), limiter.parameter("rear_angle_max")),
        )
        yield "the result is kept", pool.feq(angle, limiter.behind("rear_angle"))
        yield from moved(limiter, angle, sampling_time)
        yield from _inputs_taken(limiter)
        yield from _against_front_wheels(limiter, angle, sampling_time)
        yield from _follows(limiter, angle, sampling_time)

    return limiter_step


def _inputs_taken(limiter: Limiter) -> Iterator[tuple[str, Term]]:
    """What is out of range, or no number, counts as not available: then the last one."""
    pool = limiter.pool
    for name, largest in (("speed", "speed_max"), ("front_angle", "front_angle_max")):
        given, kept, last = limiter.call.before("input", (name,)), limiter.behind(name), limiter.before(name)
        is_there = pool.fle(pool.magnitude(given), limiter.parameter(largest))
        taken = pool.magnitude(given) if name == "speed" else given
        yield f"{name} is the one given where that is available", implied(pool, is_there, pool.feq(kept, taken))
        yield f"{name} is the last one where none is available", pool.or_(is_there, pool.feq(kept, last))
        if name == "speed":
            known = pool.or_(is_there, limiter.before("speed_known"))
            both = pool.or_(pool.and_(known, limiter.behind("speed_known")), pool.not_(known))
            yield "a speed is known once there was one", both


def _against_front_wheels(limiter: Limiter, angle: Term, sampling_time: float) -> Iterator[tuple[str, Term]]:
    """Over speed, against the front wheels: within the bound, or on the way to it as fast as may be."""
    pool, bound, front = limiter.pool, limiter.opposite_phase_bound, limiter.behind("front_angle")
    before, step, zero = limiter.before("rear_angle"), limiter.step(sampling_time), pool.real(0.0, -front.sort)
    known = limiter.behind("speed_known")
    right = pool.or_(pool.fle(pool.neg(bound), angle), pool.fle(pool.add(before, step), angle))
    left = pool.or_(pool.fle(angle, bound), pool.fle(angle, pool.sub(before, step)))
    words = "is within opposite_phase_max, or returns at rear_rate_max"
    yield f"to the right of front wheels to the left, it {words}", implied(pool, known, pool.fle(zero, front), right)
    yield f"to the left of front wheels to the right, it {words}", implied(pool, known, pool.fle(front, zero), left)


def _follows(limiter: Limiter, angle: Term, sampling_time: float) -> Iterator[tuple[str, Term]]:
    """It does what is demanded where it may, and nothing of its own."""
    pool, demand, before = limiter.pool, limiter.call.before("input", ("demand",)), limiter.before("rear_angle")
    step, zero, known = limiter.step(sampling_time), pool.real(0.0, -angle.sort), limiter.behind("speed_known")
    ends = (before, demand, zero)
    yield "it is not above its last value, the demand and zero", pool.or_(*(pool.fle(angle, each) for each in ends))
    yield "it is not below its last value, the demand and zero", pool.or_(*(pool.fle(each, angle) for each in ends))
    within_rate = pool.and_(pool.fle(pool.sub(before, step), demand), pool.fle(demand, pool.add(before, step)))
    may = (limiter.lets_through(demand), within_rate)
    yield "it is the demand where all bounds let that through", implied(pool, known, *may, pool.feq(angle, demand))
    inside = pool.fle(pool.magnitude(before), limiter.parameter("rear_angle_max"))
    yield "it is held as long as no speed is known", pool.or_(known, pool.not_(inside), pool.feq(angle, before))


def limiter_started(call: Call) -> Iterator[tuple[str, Term]]:
    """Of the limiter's initialiser."""
    pool, given, kept = call.pool, call.scalar("rear_angle"), call.behind("self", ("rear_angle",))
    is_angle = pool.fle(pool.magnitude(given), pool.real(INITIAL_ANGLE_MAX, -given.sort))
    wanted = pool.ite(is_angle, given, pool.real(0.0, -given.sort))
    yield "it starts from the angle given, from zero where that is beyond 1 rad or no number", pool.feq(kept, wanted)


def commanded(program: ParsedProgram, function: Function, sampling_time: float) -> Claims:
    """Of the controller's step: what it does in each status."""
    constants = program.units[function.unit].constants

    def controller_step(call: Call) -> Iterator[tuple[str, Term]]:
        pool, limiter = call.pool, Limiter(call, ("limiter",))
        angle, status = call.results[("rear_angle",)][1], call.results[("status",)][1]

        def is_status(name: str) -> Term:
            values = [value for key, value in constants.items() if key.endswith(f"_STATUS_{name}")]
            if len(values) != 1:
                raise LookupError(f"the status {name}")
            return pool.eq(status, pool.whole(values[0], status.sort))

        largest = call.before("parameters", ("rear_angle_max",))
        yield "|rear_angle| is at most rear_angle_max", pool.fle(pool.magnitude(angle), largest)
        yield from moved(limiter, angle, sampling_time)
        tracking = implied(
            pool, is_status("TRACKING"), _within_rates(call, call.before("self", ("rear_angle",)), angle, sampling_time)
        )
        yield "tracking, it moves by at most the lower of both rates", tracking
        before = limiter.before("rear_angle")
        shrinks = pool.fle(pool.magnitude(angle), pool.magnitude(before))
        yield "in fail-safe |rear_angle| does not grow", implied(pool, is_status("FAIL_SAFE"), shrinks)
        may_stay = limiter.lets_through(before)
        stays = pool.feq(angle, before)
        idle = pool.and_(is_status("DEGRADED"), pool.not_(call.behind("self", ("enabled",))))
        yield "degraded without control, the angle is held, where the limiter lets it", implied(pool, idle, may_stay, stays)

    return controller_step


def ruled(sampling_time: float) -> Claims:
    """Of the control law's step."""

    def law_step(call: Call) -> Iterator[tuple[str, Term]]:
        (_, angle), last = call.results[("rear_angle",)], call.scalar("rear_angle")
        yield "the command moves by at most the lower of both rates", _within_rates(call, last, angle, sampling_time)

    return law_step


def _within_rates(call: Call, before: Term, angle: Term, sampling_time: float) -> Term:
    """That an angle has moved by both rates at most, the controller's and the limiter's."""
    pool = call.pool
    own, behind = (call.before("parameters", (*path, "rear_rate_max")) for path in ((), ("limiter",)))
    step = over(pool, pool.ite(pool.flt(own, behind), own, behind), sampling_time)
    return pool.and_(pool.fle(pool.sub(before, step), angle), pool.fle(angle, pool.add(before, step)))
