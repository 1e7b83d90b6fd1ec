"""Input monitoring, written from its header, bit for bit."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any

from codegen.emit.inputs_view import AMBIGUOUS_SHARE, BANK_RATE, FRICTION_UNKNOWN, SHORT_SHARE
from codegen.sil.software import Measurement, Software
from codegen.verify.drives import NUMBER_ROLES


def strongest_braking(software: Software) -> float:
    """Return the strongest braking of the stack in the C, m/s^2; zero without a stack over longitudinal acceleration."""
    values = getattr(software.function("constants"), "longitudinal_accelerations", [0.0])
    return float(values[0])


class Quality(Enum):
    """Quality of a sample, in the order of the C enum."""

    GOOD = auto()
    REPLACED = auto()
    MISSING = auto()
    UNUSABLE = auto()


class Source(Enum):
    """Source of a signal's value."""

    MEASURED = auto()
    LOST = auto()
    WRONG = auto()


@dataclass
class Signal:
    """A signal: its current value and its counters. `good` None: trusted at once."""

    value: Any
    source: Source = Source.LOST
    missing: int = 0
    good: int | None = 0
    against: int = 0  # consecutive samples that contradict it while it is measured

    @property
    def is_measured(self) -> bool:
        return self.source is Source.MEASURED


class SecondInputs:
    """Input monitoring of all kinds.

    Args:
        period: s.
        strongest: braking of the map in m/s^2, for an unknown longitudinal acceleration.
    """

    def __init__(self, parameters: Any, real: Any, period: float, strongest: float, is_trusted: bool = True) -> None:
        self.p = parameters
        self.real = real
        self.bank_step = real(BANK_RATE * period)
        zero = real(0.0)
        self.speed, self.front_angle, self.yaw_rate = (Signal(zero, good=None if is_trusted else 0) for _ in range(3))
        self.expected = self.least = self.least_of_front = self.offset = self.lateral_offset = self.beyond = zero
        self.lateral: Any = None  # yaw rate in rad/s from the lateral acceleration, or None
        self.lateral_is_known = self.lateral_is_proven = self.turn_is_confirmed = False
        self.last_lateral = self.least_of_lateral = zero  # m/s^2, rad/s
        self.lateral_against, self.lateral_is_wrong = 0, False
        self.against = 0  # samples with a yaw rate opposite to the other signals
        self.friction = real(FRICTION_UNKNOWN)
        self.strongest = self.acceleration = real(strongest)

    def parameter(self, name: str) -> Any:
        return self.real(getattr(self.p, name))

    def step(self, measurement: Measurement, command: Any, model: tuple[Any, ...] | None = None) -> tuple[Quality, Measurement]:
        """Return the quality of a sample and the accepted values.

        Args:
            command: last command in rad.
            model: state of the reference model; None for kinds without one.
        """
        numbers: dict[str, Any] = {name: self.real(getattr(measurement, name)) for name in NUMBER_ROLES}
        m = Measurement(**numbers, inhibit=measurement.inhibit)
        p, signals = self.parameter, (self.speed, self.front_angle, self.yaw_rate)
        rear = m.rear_angle if abs(m.rear_angle) <= p("rear_angle_max") else command
        taken = [self._take_speed(m.speed)]
        if 0.0 <= m.friction <= p("friction_max"):
            self.friction = m.friction
        else:
            self.friction = min(self.friction + p("friction_recovery"), self.real(FRICTION_UNKNOWN))
        if hasattr(self.p, "longitudinal_acceleration_max"):
            if abs(m.longitudinal_acceleration) <= p("longitudinal_acceleration_max"):
                self.acceleration = m.longitudinal_acceleration
            else:
                self.acceleration = max(self.acceleration - p("longitudinal_acceleration_loss"), self.strongest)
        speed = self.speed.value
        gain = self._gain(speed)
        shows = speed >= 5.0 and abs(m.lateral_acceleration) <= p("lateral_acceleration_max")
        self.lateral = (m.lateral_acceleration - self.lateral_offset) / speed if shows else None
        if self.lateral is not None:
            self.lateral_is_known = True
            self._judge_lateral(m.lateral_acceleration)
        taken.append(self._take_front_angle(m.front_angle, gain, rear))
        driven = self._expect(gain, rear, model)
        taken.append(self._take_yaw_rate(m.yaw_rate, rear, model is not None))
        if self.front_angle.source is self.yaw_rate.source is Source.WRONG:
            self.front_angle.source = self.yaw_rate.source = Source.LOST
        if not self.yaw_rate.is_measured:
            beyond = self.real(0.0) if self._witness() is None else self._witness() - self.expected
            self.beyond += p("yaw_rate_correction_share") * (beyond - self.beyond)
            self.beyond = self._within(self.beyond, p("yaw_rate_max"))
            self.yaw_rate.value = self._within(self.expected + self.beyond, p("yaw_rate_max"))
        elif not self.front_angle.is_measured and speed >= 1.0:
            self.front_angle.value = self._within(rear + self.yaw_rate.value / gain, p("front_angle_max"))
        self.beyond = self.real(0.0) if self.yaw_rate.is_measured else self.beyond
        for signal in signals:
            if all(taken) and signal.is_measured:
                signal.missing = max(signal.missing - 2, 0)
        quality = Quality.GOOD if all(signal.is_measured for signal in signals) else Quality.REPLACED
        if not all(taken):
            quality = Quality.MISSING
        if not (self.front_angle.is_measured or self.yaw_rate.is_measured):
            quality = Quality.UNUSABLE
        yaw_rate = self.yaw_rate.value
        if self.yaw_rate.is_measured:
            if all(taken) and not m.inhibit:
                self._learn_offsets(gain, driven)
            yaw_rate = self._within(yaw_rate - self.offset, p("yaw_rate_max"))
        speed = self.speed.value
        lateral = speed * (yaw_rate if self.lateral is None else self.lateral)
        values = (speed, self.front_angle.value, yaw_rate, rear, self.friction, lateral, m.inhibit, self.acceleration)
        return quality, Measurement(*values)

    def _gain(self, speed: Any) -> Any:
        """Return the yaw rate gain of the linear car in (rad/s)/rad."""
        wheelbase = self.parameter("wheelbase")
        length = wheelbase + self.parameter("understeer_coefficient") * speed * speed
        return speed / max(length, self.real(0.25) * wheelbase)

    def _check_speed(self, angle: Any) -> None:
        """Check the speed against lateral acceleration over yaw rate, if the front angle explains the turn at that speed."""
        p, signal, yaw_rate = self.parameter, self.speed, self.yaw_rate.value
        shown = self.lateral * signal.value / yaw_rate
        if abs(self._gain(shown) * angle - yaw_rate) > p("yaw_rate_agreement"):
            return
        apart = shown - signal.value
        if not signal.is_measured:
            signal.value = self._within(signal.value + p("yaw_rate_correction_share") * apart, p("speed_max"))
        elif abs(apart) > p("speed_agreement"):
            signal.against += 1
            if signal.against >= 15 * self.p.recovery_samples:
                signal.source, signal.value, signal.against = Source.WRONG, self._within(shown, p("speed_max")), 0
        else:
            signal.against = 0

    def _take_speed(self, measured: Any) -> bool:
        p, signal = self.parameter, self.speed
        held = abs(signal.value)
        confirmed = bool(held < 1.0 or abs(measured - signal.value) <= p("speed_agreement") + self.real(0.25) * held)
        taken = self._take("speed", measured, abs(measured) <= p("speed_max"), confirmed, p("speed_step"))
        if not signal.is_measured:
            signal.value = signal.value - self._within(signal.value, p("speed_fall"))  # not beyond zero
        return taken

    def _take_front_angle(self, measured: Any, gain: Any, rear: Any) -> bool:
        p, yaw_rate = self.parameter, self.yaw_rate.value
        confirmed = self._agrees(gain * (measured - rear) - yaw_rate, yaw_rate)
        apart, step = abs(yaw_rate - self.expected), p("front_angle_step")
        if not (self.front_angle.is_measured and self.yaw_rate.is_measured):
            self.least_of_front = self.real(2.0) * p("yaw_rate_max")
        else:
            changed = measured != self.front_angle.value and not math.isnan(measured)
            self.least_of_front = apart if changed else min(self.least_of_front, apart)
        signal, witness, available = self.front_angle, self._witness(), abs(measured) <= p("front_angle_max")
        if signal.is_measured:
            goes_straight = yaw_rate * self.expected * self.speed.value < abs(self.expected)  # below 1 m/s^2 to that side
            is_frozen = self.yaw_rate.is_measured and apart - self.least_of_front > p("yaw_rate_frozen")
            agrees = witness is not None and abs(witness - yaw_rate) <= p("yaw_rate_agreement")
            signal.against = signal.against + 1 if is_frozen and available and goes_straight and agrees else 0
            if signal.against >= 3 * self.p.recovery_samples:
                step = self.real(-1.0)
        return self._take("front_angle", measured, abs(measured) <= p("front_angle_max"), confirmed, step)

    def _judge_lateral(self, measured: Any) -> None:
        """Drop the lateral acceleration while it is not to be used."""
        near, yaw_rate, largest = self.parameter("yaw_rate_agreement"), self.yaw_rate.value, 5 * self.p.recovery_samples
        apart = abs(self.lateral - yaw_rate)
        self.least_of_lateral = apart if measured != self.last_lateral else min(self.least_of_lateral, apart)
        confirmed = abs(self.expected - yaw_rate) <= near
        if abs(measured - self.last_lateral) > 2.0 or (confirmed and apart - self.least_of_lateral > near):
            self.lateral_against = largest
        elif confirmed and apart > near + self.real(0.5) * abs(yaw_rate):
            self.lateral_against = min(self.lateral_against + 1, largest)
        else:
            self.lateral_against = max(self.lateral_against - 1, 0)
        self.last_lateral = measured
        self.lateral_is_wrong = self.lateral_against == largest or (self.lateral_is_wrong and self.lateral_against > 0)
        if self.lateral_is_wrong:
            self.lateral = None

    def _witness(self) -> Any:
        """Return the yaw rate from a lateral acceleration that agreed before, or None."""
        return self.lateral if self.lateral_is_proven else None

    def _compare_with_lateral(self, angle: Any, witness: Any) -> None:
        near, yaw_rate = self.parameter("yaw_rate_agreement"), self.yaw_rate.value
        if self.lateral is None or abs(yaw_rate) <= near + near:
            return
        apart = self.lateral - yaw_rate
        if abs(apart) <= near:
            self.lateral_is_proven = True
        elif abs(self.expected - yaw_rate) > near:
            if witness is not None:
                self._check_speed(angle)
        elif abs(apart) > near + near and self.speed.is_measured:
            self.lateral_is_proven = False

    def _expect(self, gain: Any, rear: Any, model: tuple[Any, ...] | None) -> Any:
        """Set the expected yaw rate; return the one with the measured rear angle."""
        p, largest = self.parameter, self.parameter("yaw_rate_max")
        if model is None or self.speed.value < 5.0:
            turn = gain * (self.front_angle.value - rear)
            self.expected = self._within(self.expected + p("expected_share") * (turn - self.expected), largest)
            return self.expected
        _, yaw_rate, rear_angle, *_ = model
        without = self._within(yaw_rate, largest)
        driven = self._within(without - gain * (rear - rear_angle), largest)
        self.expected = driven
        if self.yaw_rate.is_measured:
            self.expected = max(min(driven, without), min(max(driven, without), self.yaw_rate.value))
        return driven

    def _learn_offsets(self, gain: Any, driven: Any) -> None:
        p, speed = self.parameter, self.speed.value
        measured, share, slow = self.yaw_rate.value, p("yaw_rate_correction_share"), self.real(AMBIGUOUS_SHARE)
        slow, before, lateral_offset = slow * share, self.offset, self.lateral_offset
        if speed >= 5.0 and abs(gain * self.front_angle.value) > p("straight_yaw_rate"):
            if self.lateral is not None:
                lateral_offset += self._within(speed * (self.lateral - (measured - before)), self.bank_step)
        elif speed >= 5.0 and abs(measured - driven) <= p("yaw_rate_offset_max"):
            missing = measured - driven - before
            if self.lateral is not None:
                lateral = self.lateral - driven
                both = self._within(missing, abs(lateral)) if missing * lateral > 0.0 else self.real(0.0)
                lateral_offset += speed * (self.real(3.0) * share * (lateral - both) + slow * both)
                self.offset += share * (missing - both) + slow * both
            elif not self.lateral_is_known:
                self.offset += share * self.real(0.0) + slow * missing
            self.offset = self._within(self.offset, p("yaw_rate_offset_max"))
        self.lateral_offset = self._within(lateral_offset, p("lateral_acceleration_offset_max"))

    def _take_yaw_rate(self, measured: Any, rear: Any, has_model: bool) -> bool:
        p, speed = self.parameter, abs(self.speed.value)
        witness = self._witness()
        apart = abs(measured - self.expected)
        grip = p("lateral_acceleration_max") + speed * p("yaw_rate_tolerance")
        is_possible = bool(abs(measured) <= p("yaw_rate_max") and abs(speed * measured) <= grip)
        is_frozen = against = False
        if not self.yaw_rate.is_measured:
            self.least = self.real(2.0) * p("yaw_rate_max")
        elif is_possible:
            self.least = apart if measured != self.yaw_rate.value else min(self.least, apart)
            is_frozen = apart - self.least > p("yaw_rate_frozen")
            against = self._contradicts(measured) if has_model else self._is_opposite(measured)
            is_frozen = is_frozen or self.against + against >= self.p.recovery_samples
        self.against = self.against + 1 if against and not is_frozen else 0
        step = self.real(-1.0) if is_frozen else p("yaw_rate_step")
        confirmed = self._agrees(measured - self.yaw_rate.value, self.yaw_rate.value)
        was_measured = self.yaw_rate.is_measured
        taken = self._take("yaw_rate", measured, is_possible, confirmed, step)
        if is_possible and was_measured and self.yaw_rate.is_measured:
            self._compare_with_lateral(self.front_angle.value - rear, witness)
        return taken

    def _agrees(self, apart: Any, turn: Any) -> bool:
        """Return whether two yaw rates agree in a turn; agreement near zero is no evidence."""
        agreement = self.parameter("yaw_rate_agreement")
        return bool(abs(apart) <= agreement and abs(turn) > agreement + agreement)

    def _contradicts(self, yaw_rate: Any) -> bool:
        """Return whether front angle and lateral acceleration agree on a turn that a yaw rate denies."""
        turns = self.expected, self.lateral
        if self.lateral is None or abs(self.lateral) <= self.parameter("yaw_rate_agreement"):
            self.turn_is_confirmed = False
        elif self._agrees(yaw_rate - self.lateral, self.lateral):
            self.turn_is_confirmed = True
        to_the_other_side = self.lateral is not None and all(yaw_rate * turn < 0.0 for turn in turns)
        return (to_the_other_side or not self.turn_is_confirmed) and all(self._falls_short(yaw_rate, turn) for turn in turns)

    def _is_opposite(self, yaw_rate: Any) -> bool:
        """Return whether front angle and lateral acceleration both show a turn to the other side."""
        if self.lateral is None or yaw_rate * self.expected >= 0.0 or yaw_rate * self.lateral >= 0.0:
            return False
        return bool(min(abs(yaw_rate), abs(self.lateral)) > self.real(2.0) * self.parameter("yaw_rate_agreement"))

    def _falls_short(self, yaw_rate: Any, turn: Any) -> bool:
        """Return whether a yaw rate is much less than that of a turn."""
        if turn is None or abs(yaw_rate - turn) <= self.real(2.0) * self.parameter("yaw_rate_agreement"):
            return False
        return bool(yaw_rate * turn < self.real(SHORT_SHARE) * (turn * turn))

    def _take(self, name: str, measured: Any, is_there: bool, is_confirmed: bool, step: Any) -> bool:
        """Return False if a signal is missing for a short time."""
        signal = getattr(self, name)
        before = signal.source
        if not signal.is_measured:
            self._prove(signal, measured, is_there and (is_confirmed or signal.source is Source.LOST))
        elif not is_there:
            signal.missing += 1
            if signal.missing > self.p.missing_samples_max:
                signal.source = Source.LOST
        elif abs(measured - signal.value) <= step * self.real(signal.missing + 1):
            signal.value = measured
        else:
            signal.source = Source.WRONG
        if signal.source is not before:
            signal.against = 0
        return bool(is_there) or not signal.is_measured

    def _prove(self, signal: Signal, measured: Any, speaks_for_it: bool) -> None:
        if not speaks_for_it:
            is_lost = signal.source is Source.LOST
            counts = is_lost and signal.good is not None and 0 < signal.good < self.p.recovery_samples
            signal.good = (signal.good or 0) - 1 if counts else 0
            return
        signal.good = None if signal.good is None else signal.good + 1
        if signal.good is None or signal.good >= self.p.recovery_samples:
            signal.value, signal.source, signal.missing, signal.good = measured, Source.MEASURED, 0, 0

    def _within(self, value: Any, largest: Any) -> Any:
        return max(min(value, largest), -largest)
