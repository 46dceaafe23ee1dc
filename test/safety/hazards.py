# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
The hazards of ``docs/safety.md`` in virtual time: what happens, and the bound of the stop time.

``worst`` runs a hazard at many phases of all cycles and at all rates. Each run has its own
conditions within the allowance: one stall of each thread, messages that are late, lost, doubled
and thereby reordered. ``python test/safety/hazards.py`` prints the table of ``docs/safety.md``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
import math
import random
from typing import Any

from smart_tire.samples import MotorCommand, VelocityCommand, WheelSample
from support.motor_boards import Record, STILL
from support.virtual_robot import (
    COMMANDER, Conditions, CONTROLLER, DRIVER, FOLLOWER, FollowingRobot, SPEED, stop_time,
    STRANGER, VirtualRobot)

RATES = (4.0, 16.0, 50.0, 100.0, 200.0)  # Hz, of readings and of the control
PHASES = 50            # of a cycle, at least
HEALTH_CYCLE = 0.15    # s, both boards
MAX_STALL = 0.02       # s, of each thread, once, the allowance
MAX_LATENESS = 0.02    # s, of a message
DRIVING_AT = 0.8       # s after the start, when the duties are steady
LONGER = 0.3           # s of a run after the bound
MARGIN = 1.3           # of a bound over the worst stop time found, at most
ACTORS = (DRIVER, CONTROLLER, 'port', 'write')

Fault = Callable[[VirtualRobot], None]


@dataclass(frozen=True, kw_only=True)
class Hazard:
    """One hazard: ``fault`` happens at a robot that drives."""

    bound: float                        # s, from the fault to zero duty
    fault: Fault
    prepare: Fault = lambda robot: None
    resumes: bool = False               # whether the motors may have a duty again afterwards
    at: float = DRIVING_AT              # s after the start
    since: Callable[[Record], float] | None = None  # time from which the stop time counts
    robot: type[VirtualRobot] = VirtualRobot
    rates: tuple[float, ...] = RATES
    settings: Mapping[str, Any] = field(default_factory=dict)  # of the conditions

    def run(self, conditions: Conditions, phase: float) -> tuple[float, Record, VirtualRobot]:
        """Return the stop time [s] if the fault happens at a ``phase`` (0 to 1) of the cycles."""
        conditions = replace(conditions, **self.settings)
        cycle = max(HEALTH_CYCLE, 1.0 / conditions.rate, 1.0 / conditions.control_rate)
        robot = self.robot(conditions)
        self.prepare(robot)
        record = robot.run(self.at + phase * cycle, self.fault, self.bound + LONGER)
        if self.since is None:
            seconds = stop_time(record)
        else:
            begin = self.since(record)
            seconds = min((when - begin for when, duty in record.duties
                           if when > begin and duty == STILL), default=math.inf)
        return seconds, record, robot


def conditions_of(name: str, number: int, rate: float) -> Conditions:
    """Return the conditions of a run: phases, and disturbances within the allowance."""
    rng = random.Random(f'{name} {rate} {number}')
    topics = ('motor_commands', 'wheel_states', 'cmd_vel')
    soon = rng.choice((MAX_STALL, 0.3))  # half of all stalls are close to the fault
    return Conditions(
        rate=rate, control_rate=rate, phases=tuple(rng.random() for _ in range(4)),
        turnaround=rng.uniform(1e-4, 4e-4), transit=rng.uniform(2e-4, 2e-3),
        stalls=tuple((name, rng.uniform(-MAX_STALL, soon), MAX_STALL) for name in ACTORS),
        late=tuple((topic, rng.randrange(8), rng.uniform(0.0, MAX_LATENESS)) for topic in topics),
        lost=((rng.choice(topics), rng.randrange(8)),),
        doubled=((rng.choice(topics), rng.randrange(8)),))


def fails(**faults: Any) -> Fault:
    """Return a fault of the boards."""
    return lambda robot: robot.fail(**faults)


def commands_end(robot: VirtualRobot) -> None:
    """Send one more command, and none after it."""
    robot.publish('cmd_vel', robot.velocity(), COMMANDER)
    robot.command = lambda: None


def commands_are_nan(robot: VirtualRobot) -> None:
    """Send one more command, then NaN."""
    robot.publish('cmd_vel', robot.velocity(), COMMANDER)
    robot.command = lambda: VelocityCommand(robot.clock.time_ns(), math.nan, 0.0)


def constant_duty(robot: VirtualRobot) -> None:
    """Give every motor a duty of 0.15, without the controller."""
    robot.stop(CONTROLLER)
    robot.every(COMMANDER, 0.05, 0.0, lambda: robot.publish('motor_commands', MotorCommand(
        robot.clock.time_ns(), (0.15,) * 4), CONTROLLER))


def stopped(*names: str) -> Fault:
    """Return the fault that processes are stopped or killed."""
    return lambda robot: robot.stop(*names)


def unplugged(robot: VirtualRobot) -> None:
    """Disconnect the cable."""
    robot.port.plugged = False


def engage(robot: VirtualRobot) -> None:
    """Call the emergency stop."""
    robot.send(DRIVER, robot.output.engage, robot.conditions.late[0][2])


def releases(robot: VirtualRobot) -> None:
    """Call the emergency stop while another client releases it 500 times a second."""
    engage(robot)
    robot.every(COMMANDER, 0.002, 0.0, lambda: robot.send(DRIVER, robot.output.release))


def second(topic: str, sample: Callable[[int], Any]) -> Fault:
    """Return the fault that another node publishes on ``topic``, too."""
    def fault(robot: VirtualRobot) -> None:
        def send() -> None:
            robot.publish(topic, sample(robot.clock.time_ns()), STRANGER)

        send()
        robot.every(COMMANDER, 0.05, 0.5, send)
    return fault


def queued(robot: VirtualRobot) -> None:
    """Stop both processes, and let motor_driver continue 0.15 s later."""
    robot.stop(DRIVER, CONTROLLER)
    robot.clock.at(robot.clock.now_ns() + 150_000_000, lambda: robot.resume(DRIVER))


def starting(**faults: Any) -> dict[str, Any]:
    """Return the fields of a hazard that exists before the robot starts."""
    def prepare(robot: VirtualRobot) -> None:
        robot.command = lambda: None

    def fault(robot: VirtualRobot) -> None:
        robot.fail(**faults)
        robot.command = lambda: VelocityCommand(robot.clock.time_ns(), SPEED, 0.0)

    return {'prepare': prepare, 'fault': fault, 'since': Record.first_duty,
            'settings': {'speed': 0.0}}


def readings_fail(value: float) -> Fault:
    """Return the fault that the speed of a wheel is read as ``value``."""
    def fault(robot: VirtualRobot) -> None:
        publish = robot.publish

        def spoiled(topic: str, sample: Any, sender: str) -> None:
            if topic == 'wheel_states':
                sample = WheelSample(sample.stamp_ns, (value, *sample.velocity[1:]))
            publish(topic, sample, sender)

        robot.publish = spoiled  # type: ignore[method-assign]
    return fault


def odom(speed: float | None) -> Fault:
    """Return the fault that ``odom`` moves at ``speed`` [m/s], unlike the wheels, or ends."""
    def fault(robot: VirtualRobot) -> None:
        assert isinstance(robot, FollowingRobot)
        robot.odom_speed = lambda _: speed
    return fault


def second_path(robot: VirtualRobot) -> None:
    """Publish a path from another node."""
    assert isinstance(robot, FollowingRobot)
    robot.order(STRANGER)


CREEPING = {'speed': 0.1}  # m/s
following = partial(Hazard, robot=FollowingRobot, at=1.2)
either = (128, 129)
HAZARDS: Mapping[str, Hazard] = {
    'replies of both boards lost': Hazard(bound=0.3, fault=fails(mute={128, 129})),
    **{f'replies of board {one} lost': Hazard(bound=0.3, fault=fails(mute={one}))
       for one in either},
    'replies of both boards garbled': Hazard(bound=0.3, fault=fails(garbled={128, 129})),
    **{f'replies of board {one} garbled': Hazard(bound=0.3, fault=fails(garbled={one}))
       for one in either},
    'line flooded towards the host': Hazard(bound=0.3, fault=fails(flood=True)),
    'requests garbled': Hazard(bound=0.55, fault=fails(deaf=True)),
    'replies lost, and duties ignored': Hazard(bound=0.55, fault=fails(
        mute={128, 129}, ignoring_duties={128, 129})),
    **{f'encoder of wheel {wheel} frozen': Hazard(bound=0.5, fault=fails(frozen={wheel}))
       for wheel in range(4)},
    'encoder frozen at 0.1 m/s': Hazard(
        bound=0.5, fault=fails(frozen={0}), settings=CREEPING),
    'encoder frozen in open loop at duty 0.15': Hazard(
        bound=0.5, fault=fails(frozen={1}), prepare=constant_duty, settings={'speed': 0.28}),
    'encoder frozen before the start': Hazard(bound=0.5, **starting(frozen={1})),
    'encoder channel open': Hazard(bound=0.5, fault=fails(toggling={1})),
    'encoder channel open at 0.1 m/s': Hazard(
        bound=0.5, fault=fails(toggling={1}), settings=CREEPING),
    'encoder loses 80 % of its counts': Hazard(bound=1.0, fault=fails(losing={2: 0.8})),
    'encoder loses 80 % of its counts at 0.1 m/s': Hazard(
        bound=1.0, fault=fails(losing={2: 0.8}), settings=CREEPING),
    'wheel blocked': Hazard(bound=0.5, fault=fails(blocked={3})),
    **{f'encoder or motor of wheel {wheel} reversed': Hazard(
        bound=0.5, fault=fails(reversed={wheel})) for wheel in range(4)},
    'encoder or motor reversed before the start': Hazard(bound=0.5, **starting(reversed={1})),
    **{f'board {one} restarted': Hazard(
        bound=0.5, fault=lambda robot, one=one: robot.boards.restart(one, robot.now),
        resumes=True) for one in either},
    **{f'status of board {one} abnormal': Hazard(bound=0.5, fault=fails(status={one: 4}))
       for one in either},
    **{f'supply of board {one} low': Hazard(bound=0.5, fault=fails(supply={one: 90}))
       for one in either},
    'cmd_vel ends': Hazard(bound=0.35, fault=commands_end),
    'cmd_vel becomes NaN': Hazard(bound=0.35, fault=commands_are_nan),
    'queued motor_commands': Hazard(bound=0.5, fault=queued),
    'speed of a wheel NaN': Hazard(bound=0.5, fault=readings_fail(math.nan)),
    'speed of a wheel above 100 rad/s': Hazard(bound=0.5, fault=readings_fail(101.0)),
    'emergency stop': Hazard(bound=0.3, fault=engage),
    'emergency stop, released 500 times a second': Hazard(bound=0.3, fault=releases),
    'second publisher on motor_commands': Hazard(bound=0.3, fault=second(
        'motor_commands', lambda now_ns: MotorCommand(now_ns, (1.0,) * 4))),
    'second publisher on wheel_states': Hazard(bound=0.3, fault=second(
        'wheel_states', lambda now_ns: WheelSample(now_ns, (0.0,) * 4))),
    'second publisher on cmd_vel': Hazard(bound=0.3, fault=second(
        'cmd_vel', lambda now_ns: VelocityCommand(now_ns, 1.4, 0.0))),
    'wheel_controller killed or stopped': Hazard(bound=0.5, fault=stopped(CONTROLLER)),
    'motor_driver killed or stopped': Hazard(bound=0.5, fault=stopped(DRIVER)),
    'host frozen': Hazard(bound=0.5, fault=stopped(DRIVER, CONTROLLER)),
    'cable disconnected': Hazard(bound=0.5, fault=unplugged),
    'odom repeats one pose': following(bound=1.0, fault=odom(0.0)),
    'odom creeps at 2.5 cm/s': following(bound=1.0, fault=odom(0.025)),
    'odom runs backward': following(bound=1.0, fault=odom(-0.3)),
    'odom ends': following(bound=0.9, fault=odom(None)),
    'second publisher on path': following(bound=0.5, fault=second_path),
    'trajectory_controller killed or stopped': following(bound=0.35, fault=stopped(FOLLOWER)),
}


def worst(name: str, rate: float, phases: int = PHASES) -> tuple[float, int]:
    """
    Return the longest stop time of a hazard [s], and the number of its run.

    Fails if a motor has a duty again after it.
    """
    hazard, found = HAZARDS[name], []
    for number in range(phases):
        conditions = conditions_of(name, number, rate)
        seconds, record, _ = hazard.run(conditions, number / phases)
        if not hazard.resumes and seconds < math.inf:
            begin = hazard.since(record) if hazard.since else record.duties[0][0]
            after = record.after(begin + seconds)
            assert not after.driven(), (name, rate, number, after.duties)
        found.append((seconds, number))
    return max(found)
