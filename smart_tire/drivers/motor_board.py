# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""One motor board: its encoders, their plausibility against the duty, and its latest replies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
import itertools
import math

from smart_tire.drivers.clock import Clock
from smart_tire.drivers.roboclaw_line import RoboclawLine
from smart_tire.models.vehicle.drive import measured_torque
from smart_tire.parameters.hardware import MotorDriverParams
from smart_tire.protocol.roboclaw import count_step, current_from_code, READ_CURRENTS
from smart_tire.samples import NAN, NS_PER_S, WHEELS

MAX_SPEED = 100.0           # rad/s; a larger step of the counts means that the board lost them
MIN_DRIVING_DUTY = 0.05     # -, below it gear friction may stop a wheel
MIN_ROLLING_SPEED = 0.5     # rad/s, above it a wheel counts as rolling
MIN_ROLLING_COUNTS = 4      # counts of a rolling wheel within two stall times, in 1.5 counts
MIN_DUTY_RATIO = 0.9        # duty over that of the rolling wheel, above which it is not reduced
# N m, of the mean of measured torques: three sigma of noise (0.05) and offset (0.015), see
# errors.torque_noise and errors.torque_offset of the simulator
MAX_TORQUE_ERROR = 0.1
MAX_HELD_PERIOD = 0.1       # s between readings; 1.6 times that at the lowest rate
MIN_MEASURED = 2            # readings of the torque within the stall time, for their mean
# Of a wheel that lags behind the other one of its side, over three stall times; no simulated drive
# on slopes of 8 degrees, with motors 20 % off, was stopped.
MAX_SIDE_RATIO = 0.4        # speed over that of the other wheel
MIN_EXTRA_DUTY = 0.1        # duty above that of the other wheel
# Torque of the tire over stall torque at most, friction * load * radius: 0.47 * 26.7 N * 0.087 m
# is 0.22 of a stall torque of 5 N m, and about twice that on surfaces with high friction.
MAX_LOAD = 0.5
CHECK_PERIOD_NS = 45_000_000     # between checks of the motion: four or more in a stall time
CURRENT_RETRY_PERIOD = 0.25      # s, after the second missing reply; doubles with each further
MAX_CURRENT_RETRY_PERIOD = 10.0  # s, also between requests to a board without that command
MAX_CURRENT_RATE = 50.0    # Hz, of readings of the currents of a board
MAX_CURRENT_WAIT = 0.02    # s for a reply with currents, at most one poll period
MIN_MISSING_CURRENTS = 4   # consecutive missing replies that are reported


class WheelEncoder:
    """Unwraps the counts of one encoder; ``sign`` is -1 if it counts backwards."""

    def __init__(self, sign: int, counts_per_revolution: float) -> None:
        self.sign = sign
        self.resolution = math.tau / counts_per_revolution  # rad, angle of one count
        self._count: int | None = None
        self.position = 0.0  # rad, unwrapped
        self.jumped = False  # whether the latest step exceeded MAX_SPEED

    def add_count(self, count: int, elapsed: float) -> None:
        """Update the angle with a count read ``elapsed`` seconds after the previous one."""
        self.jumped = False
        if self._count is not None and elapsed > 0.0:
            step = self.sign * count_step(count, self._count) * self.resolution
            self.jumped = abs(step) > MAX_SPEED * elapsed
            if not self.jumped:
                self.position += step
        self._count = count


@dataclass(frozen=True, slots=True)
class Reading:
    """Angle of a wheel, duty and torque of its motor at one time."""

    time: float      # s
    position: float  # rad
    duty: float      # [-1, 1]
    torque: float    # N m at the wheel, NaN if it was not measured at about this duty


class MotionCheck:
    """
    Plausibility check of an encoder by a model of its motor.

    With duty d and torque tau at the wheel the motor turns at ``w_0 (d - tau / tau_0)``, with
    free speed w_0 and stall torque tau_0. Speed, duty and torque are averaged over the stall
    time, which leaves this linear relation as it is. An encoder that reports less than the duty
    and the largest torque permit is a fault. The largest torque is the measured one with its
    errors; if the board does not measure it, the largest one of the tire. The torque that
    accelerates wheel and robot as the encoder reports is added: not every board measures the
    current of a braking motor.

    Two wheels of one side are compared with each other, which needs no torque: see ``lag``.

    A wheel that does not turn at ``stall_duty``, or that was rolling and stops although its duty
    is not reduced, is blocked or its encoder is broken: a fault, too.
    """

    def __init__(self, params: MotorDriverParams, resolution: float) -> None:
        """Check against the motor of ``params``; ``resolution`` is the angle of a count [rad]."""
        self._params, self._toggle = params, 1.5 * resolution  # rad, above one count
        robot = params.robot
        self._inertia = robot.motor.inertia + robot.mass / len(WHEELS) * robot.wheel_radius**2
        self._readings: list[Reading] = []  # of the latest three stall times

    def reset(self) -> None:
        """Discard all readings, after a pause."""
        self._readings = []

    def check_reading(self, latest: Reading) -> str:
        """Add a reading; return a description of the fault, '' if there is none."""
        begin = latest.time - self._params.stall_time
        self._readings = [one for one in self._readings
                          if one.time > begin - 2.0 * self._params.stall_time] + [latest]
        count = sum(one.time <= begin for one in self._readings)
        if count == 0 or latest.duty == 0.0:
            return ''
        before, during = self._readings[:count], self._readings[count - 1:]
        duty, load = self._duty_and_load(during)
        if abs(duty) < MIN_DRIVING_DUTY:
            return ''
        turned = math.copysign(1.0, duty) * (during[-1].position - during[0].position)
        stopped = abs(turned) < self._toggle and (
            abs(duty) >= self._params.stall_duty or self._was_rolling(before))
        lowest = self._unloaded_speed(abs(duty) - load) * (during[-1].time - during[0].time)
        if stopped or turned + self._toggle < lowest:
            return self._description(turned, duty)
        return ''

    def lag(self, other: MotionCheck) -> str:
        """
        Return why this wheel contradicts the ``other`` one of its side, '' if it does not.

        Both roll under the same body: one whose motor has the higher duty is not much slower.
        """
        own, others = self._mean(), other._mean()
        if own is None or others is None:
            return ''
        direction = math.copysign(1.0, own[1])
        speed, duty, other_speed, other_duty = (direction * one for one in (*own, *others))
        if (duty < other_duty + MIN_EXTRA_DUTY or other_speed < MIN_ROLLING_SPEED
                or not 0.0 <= speed < MAX_SIDE_RATIO * other_speed):
            return ''
        return (f'turns at {own[0]:.2f} rad/s under duty {own[1]:.2f}, the other wheel of its '
                f'side at {others[0]:.2f} rad/s under {others[1]:.2f}: blocked, or counts lost')

    def _mean(self) -> tuple[float, float] | None:
        """Return mean speed [rad/s] and duty of the readings, None before they span the window."""
        readings = self._readings
        if not readings or (elapsed := readings[-1].time - readings[0].time) < (
                2.5 * self._params.stall_time):
            return None
        return ((readings[-1].position - readings[0].position) / elapsed,
                math.fsum(one.duty for one in readings[1:]) / (len(readings) - 1))

    def _description(self, turned: float, duty: float) -> str:
        before, latest = self._readings[-2:]
        if min(abs(turned), abs(latest.position - before.position)) < self._toggle:
            return f'no encoder counts under duty {duty:.2f}: wheel blocked or encoder broken'
        if turned < 0.0:
            return f'turns against duty {duty:.2f}: encoder or motor reversed'
        return (f'turns too slowly under duty {duty:.2f}: encoder counts lost, or free_speed or '
                'stall_torque wrong')

    def _duty_and_load(self, readings: Sequence[Reading]) -> tuple[float, float]:
        """Return the mean duty and the largest load as a duty, torque over stall torque."""
        params, speeds = self._params, [
            (late.position - early.position) / (late.time - early.time)
            for early, late in itertools.pairwise(readings)]
        inertial = self._inertia * abs(speeds[-1] - speeds[0]) / (
            (readings[-1].time - readings[0].time) * params.stall_torque)
        held = [(_held(early, late), abs(late.torque))
                for early, late in itertools.pairwise(readings)]
        measured = [one for one in held if not math.isnan(one[1])]
        if len(measured) < MIN_MEASURED:
            return math.fsum(duty for duty, _ in held) / len(held), MAX_LOAD + inertial
        torque = math.fsum(torque for _, torque in measured) / len(measured)
        ratio = (1.0 + params.motor_tolerance) / (1.0 - params.motor_tolerance)
        return (math.fsum(duty for duty, _ in measured) / len(measured),
                (ratio * torque + MAX_TORQUE_ERROR) / params.stall_torque + inertial)

    def _unloaded_speed(self, duty: float) -> float:
        """Return the lowest speed [rad/s] of a motor without load at ``duty``."""
        tolerance = math.copysign(self._params.motor_tolerance, duty)
        return (1.0 - tolerance) * self._params.free_speed * duty

    def _was_rolling(self, before: Sequence[Reading]) -> bool:
        """Return whether the wheel was driven ``before``, at a duty that was not reduced since."""
        first, last = before[0], before[-1]
        direction = math.copysign(1.0, last.duty)
        duties = [direction * one.duty for one in self._readings]
        most = max(duties[:len(before)])
        driven = (min(duties) >= MIN_DRIVING_DUTY
                  and min(duties[duties.index(most):]) >= MIN_DUTY_RATIO * most)
        turned = direction * (last.position - first.position)
        return driven and turned >= max(MIN_ROLLING_SPEED * (last.time - first.time),
                                        MIN_ROLLING_COUNTS * self._toggle)


def _held(early: Reading, late: Reading) -> float:
    """
    Return the duty between two readings: that of the later one, at which its torque was measured.

    A stall of the host moves them apart; meanwhile the duty may have been the other one, and the
    smaller one counts.
    """
    if late.time - early.time < MAX_HELD_PERIOD:
        return late.duty
    return min(early.duty, late.duty, key=abs)


@dataclass
class Board:
    """One board with the encoders of its axle and its latest replies."""

    address: int
    name: str
    encoders: list[WheelEncoder]
    checks: list[MotionCheck]
    read_ns: int = 0             # steady clock, latest reading of the encoders; 0: none
    sampled: list[float] = field(default_factory=lambda: [0.0, 0.0])  # rad, at the last sample
    span_ns: int = 0             # since the last sample
    duty: tuple[float, float] = (0.0, 0.0)  # at the motor terminals, as acknowledged
    driven: Sequence[float] = (0.0, 0.0)    # the same, forward, at the latest reading
    zero_replies: int = 0        # consecutive acknowledgments of zero duty
    torques: tuple[float, ...] = (NAN, NAN)  # N m, forward, at the wheels; of the latest poll
    measured: tuple[tuple[float, float], ...] = ()  # duties and torques since the last check
    checked_ns: int = 0          # steady clock, of the readings of the latest check
    missing_currents: int = 0    # consecutive requests for currents without a good reply
    currents_ns: int = 0         # steady clock, before which currents are not requested
    low_readings: int = 0        # of the supply voltage, consecutive
    supply_voltage: float = math.nan  # V

    def reset(self) -> None:
        """Discard readings from before a pause."""
        self.read_ns, self.measured = 0, ()
        self.begin_span()
        for check in self.checks:
            check.reset()

    def check_motion(self) -> list[str]:
        """Return a fault of each wheel, '' if there is none; at most every ``CHECK_PERIOD``."""
        if not self.read_ns or self.read_ns - self.checked_ns < CHECK_PERIOD_NS:
            return []
        measured = self.measured or [(duty, NAN) for duty in self.driven]
        self.checked_ns, self.measured = self.read_ns, ()
        # a duty that was sent after the reading has not moved the wheel before it
        return [check.check_reading(Reading(self.read_ns / NS_PER_S, encoder.position, *(
            of_torque if abs(of_torque[0] - driven) < MIN_DRIVING_DUTY else (driven, NAN))))
            for encoder, check, driven, of_torque in zip(
                self.encoders, self.checks, self.driven, measured)]

    def forward_duty(self) -> list[float]:
        """Return the duties, positive driving forward."""
        return [encoder.sign * duty for encoder, duty in zip(self.encoders, self.duty)]

    def begin_span(self) -> None:
        """Begin a new period of the mean speeds."""
        self.sampled, self.span_ns = [encoder.position for encoder in self.encoders], 0

    def mean_speeds(self) -> list[float]:
        """Return the mean speeds [rad/s] of both wheels since the last sample."""
        positions = [encoder.position for encoder in self.encoders]
        elapsed = self.span_ns / NS_PER_S
        return [(new - old) / elapsed for old, new in zip(self.sampled, positions)]

    def postpone_currents(self, now_ns: int) -> None:
        """Count a missing reply; after the second one, wait longer each time."""
        if self.missing_currents:
            doublings = min(self.missing_currents - 1, 10)
            wait = min(CURRENT_RETRY_PERIOD * 2**doublings, MAX_CURRENT_RETRY_PERIOD)
            self.currents_ns = now_ns + round(wait * NS_PER_S)
        self.missing_currents += 1


class CurrentReader:
    """Reads currents and writes the torques into the boards."""

    def __init__(self, params: MotorDriverParams, boards: Sequence[Board], line: RoboclawLine,
                 poll_period: float, clock: Clock) -> None:
        self._params, self._boards, self._line, self._clock = params, boards, line, clock
        self._polls = 0
        self._interval = math.ceil(1.0 / (poll_period * MAX_CURRENT_RATE))  # in polls
        self._wait = min(MAX_CURRENT_WAIT, poll_period)  # s
        self.missing = 0   # requests for currents without a good reply
        self.rejected = 0  # currents beyond ``max_current``

    def silent_boards(self) -> list[str]:
        """Return the boards that do not report the currents of their motors."""
        return [board.name for board in self._boards
                if board.missing_currents >= MIN_MISSING_CURRENTS]

    def read(self, before_each: Callable[[], None]) -> None:
        """Read the boards whose turn it is, those that may not reply last."""
        self._polls += 1
        due = []
        for index, board in enumerate(self._boards):
            board.torques = NAN, NAN
            turn = self._polls + index * (self._interval // 2)
            if not turn % self._interval and self._clock.now_ns() >= board.currents_ns:
                due.append(board)
        for board in sorted(due, key=lambda board: board.missing_currents):
            before_each()
            self._read_torques(board)

    def _read_torques(self, board: Board) -> None:
        codes = self._line.ask(board.address, READ_CURRENTS, self._wait)
        if codes is None:
            self.missing += 1
            board.postpone_currents(self._clock.now_ns())
            return
        board.missing_currents = 0
        currents = map(current_from_code, codes)
        board.torques = tuple(map(self._torque, currents, board.duty, board.encoders,
                                  board.mean_speeds()))
        board.measured = tuple(zip(board.forward_duty(), board.torques))

    def _torque(self, current: float, duty: float, encoder: WheelEncoder, speed: float) -> float:
        """Return the torque [N m] of ``current`` [A]; NaN if that is not plausible."""
        if not abs(current) <= self._params.max_current:
            self.rejected += 1
            return NAN
        motor = self._params.robot.motor
        return encoder.sign * measured_torque(
            current, duty, encoder.sign * speed, torque_constant=motor.torque_constant,
            current_sign=motor.current_sign)
