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

``worst`` runs a hazard at many phases of all cycles. Each run has its own conditions within the
allowance: one stall of each thread, messages that are late, lost, doubled and thereby reordered.
``python test/support/hazards.py`` writes the table of ``docs/safety.md``: 6 minutes on two cores.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
import math
from pathlib import Path
import random
import re
import sys
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from smart_tire.samples import MotorCommand, VelocityCommand, WheelSample  # noqa: E402
from support.motor_boards import ADDRESSES, Record, STILL  # noqa: E402
from support.virtual_robot import (  # noqa: E402
    COMMANDER, Conditions, CONTROLLER, DRIVER, FOLLOWER, FollowingRobot, SPEED, STRANGER,
    VirtualRobot)

DOCUMENT = Path(__file__).resolve().parents[2] / 'docs' / 'safety.md'
README = DOCUMENT.parents[1] / 'README.md'
SENTENCE = re.compile(r'within [\d.]+ s \(lost encoder counts: [^)]*\)')
OTHERS = re.compile('odom|.*counts')  # hazards that the sentence names apart
BEGIN, END = '<!-- begin bounds -->', '<!-- end bounds -->'

RATES = (4.0, 16.0, 50.0, 100.0, 200.0)  # Hz, of readings and of the control
PHASES = 50            # of a cycle, for each board
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)  # of its multiples, any number are evenly spread over 0 to 1
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
    """One hazard: a fault, of any board or wheel, happens at a robot that drives."""

    bound: float                        # s, from the fault to zero duty
    faults: tuple[Fault, ...]           # the same at different boards or wheels
    prepare: Fault = lambda robot: None
    resumes: bool = False               # whether the motors may have a duty again afterwards
    at: float = DRIVING_AT              # s after the start
    since: Callable[[Record], float] | None = None  # time from which the stop time counts
    robot: type[VirtualRobot] = VirtualRobot
    settings: Mapping[str, Any] = field(default_factory=dict)  # of the conditions

    def stop_time(self, conditions: Conditions, number: int) -> float:
        """
        Return the stop time [s] in the run ``number``, which determines phase and fault.

        Until the motors have zero duty for good, except if it ``resumes``; infinity if never.
        """
        conditions = replace(conditions, **self.settings)
        cycle = max(HEALTH_CYCLE, 1.0 / conditions.rate, 1.0 / conditions.control_rate)
        robot = self.robot(conditions)
        self.prepare(robot)
        phase = (number // len(self.faults) * GOLDEN) % 1.0
        record = robot.run(self.at + phase * cycle, self.faults[number % len(self.faults)],
                           self.bound + LONGER)
        begin = record.duties[0][0] if self.since is None else self.since(record)
        assert self.since or record.duties[0][1] != STILL, 'not driven at the time of the fault'
        stops = [when for when, duty in record.duties if when > begin and duty == STILL]
        if not stops or not self.resumes and record.duties[-1][1] != STILL:
            return math.inf
        return (stops[0] if self.resumes else stops[-1]) - begin


def conditions_of(name: str, number: int, rate: float) -> Conditions:
    """Return the conditions of a run: phases, and disturbances within the allowance."""
    rng = random.Random(f'{name} {rate} {number}')
    topics = ('motor_commands', 'wheel_states', 'cmd_vel')
    soon = rng.choice((MAX_STALL, 0.3))  # half of all stalls are close to the fault
    return Conditions(
        rate=rate, control_rate=rate, rolling=True, phases=tuple(rng.random() for _ in range(4)),
        turnaround=rng.uniform(1e-4, 4e-4), transit=rng.uniform(2e-4, 2e-3),
        stalls=tuple((name, rng.uniform(-MAX_STALL, soon), MAX_STALL) for name in ACTORS),
        late=tuple((topic, rng.randrange(8), rng.uniform(0.0, MAX_LATENESS)) for topic in topics),
        lost=((rng.choice(topics), rng.randrange(8)),),
        doubled=((rng.choice(topics), rng.randrange(8)),))


def fails(*variants: Mapping[str, Any], **faults: Any) -> tuple[Fault, ...]:
    """Return the same fault at different boards or wheels."""
    return tuple(lambda robot, one=one: robot.fail(**one) for one in variants or [faults])


def each(name: str, places: Iterable[int], value: Any = None) -> list[dict[str, Any]]:
    """Return the fault ``name`` at each of some boards or wheels, with a ``value`` if it has."""
    return [{name: {place} if value is None else {place: value}} for place in places]


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
    robot.send(DRIVER, robot.engage, robot.conditions.late[0][2])


def releases(robot: VirtualRobot) -> None:
    """Call the emergency stop while another client releases it 500 times a second."""
    engage(robot)
    robot.every(COMMANDER, 0.002, 0.0, lambda: robot.send(DRIVER, robot.release))


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


def starting(name: str) -> dict[str, Any]:
    """Return the fields of a hazard of an encoder that exists before the robot starts."""
    def prepare(robot: VirtualRobot) -> None:
        robot.command = lambda: None

    def fault(wheel: int, robot: VirtualRobot) -> None:
        robot.fail(**{name: {wheel}})
        robot.command = lambda: VelocityCommand(robot.clock.time_ns(), SPEED, 0.0)

    return {'prepare': prepare, 'faults': tuple(partial(fault, wheel) for wheel in range(4)),
            'since': Record.first_duty, 'settings': {'rolling': False}}


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
HAZARDS: Mapping[str, Hazard] = {
    'replies of both boards lost': Hazard(bound=0.16, faults=fails(mute={*ADDRESSES})),
    'replies of one board lost': Hazard(bound=0.15, faults=fails(*each('mute', ADDRESSES))),
    'replies of both boards garbled': Hazard(bound=0.07, faults=fails(garbled={*ADDRESSES})),
    'replies of one board garbled': Hazard(bound=0.08, faults=fails(*each('garbled', ADDRESSES))),
    'line flooded towards the host': Hazard(bound=0.07, faults=fails(flood=True)),
    'requests garbled': Hazard(bound=0.62, faults=fails(deaf=True)),
    'replies lost, duties ignored': Hazard(bound=0.62, faults=fails(
        mute={*ADDRESSES}, ignoring_duties={*ADDRESSES})),
    'encoder frozen': Hazard(bound=0.3, faults=fails(*each('frozen', range(4)))),
    'encoder frozen at 0.1 m/s': Hazard(
        bound=0.36, faults=fails(*each('frozen', range(4))), settings=CREEPING),
    'encoder frozen in open loop at duty 0.15': Hazard(
        bound=0.32, faults=fails(*each('frozen', range(4))), prepare=constant_duty,
        settings={'speed': 0.28}),
    'encoder frozen before the start': Hazard(bound=0.35, **starting('frozen')),
    'encoder channel open': Hazard(bound=0.31, faults=fails(*each('toggling', range(4)))),
    'encoder channel open at 0.1 m/s': Hazard(
        bound=0.38, faults=fails(*each('toggling', range(4))), settings=CREEPING),
    'encoder loses 80 % of its counts': Hazard(
        bound=0.31, faults=fails(*each('losing', range(4), 0.8))),
    'encoder loses 80 % of its counts at 0.1 m/s': Hazard(
        bound=0.56, faults=fails(*each('losing', range(4), 0.8)), settings=CREEPING),
    'wheel blocked': Hazard(bound=0.38, faults=fails(*each('blocked', range(4)))),
    'encoder or motor reversed': Hazard(bound=0.3, faults=fails(*each('reversed', range(4)))),
    'encoder or motor reversed before the start': Hazard(bound=0.39, **starting('reversed')),
    'board restarted': Hazard(bound=0.17, resumes=True, faults=tuple(
        lambda robot, one=one: robot.boards.restart(one, robot.now) for one in ADDRESSES)),
    'board status not normal': Hazard(bound=0.24, faults=fails(*each('status', ADDRESSES, 4))),
    'supply low': Hazard(bound=0.42, faults=fails(*each('supply', ADDRESSES, 90))),
    'cmd_vel ends': Hazard(bound=0.46, faults=(commands_end,)),
    'cmd_vel becomes NaN': Hazard(bound=0.46, faults=(commands_are_nan,)),
    'queued motor_commands': Hazard(bound=0.31, faults=(queued,)),
    'speed of a wheel NaN or too high': Hazard(bound=0.61, faults=(
        readings_fail(math.nan), readings_fail(101.0))),
    'emergency stop': Hazard(bound=0.07, faults=(engage,)),
    'emergency stop, released 500 times a second': Hazard(bound=0.07, faults=(releases,)),
    'second publisher on motor_commands': Hazard(bound=0.07, faults=(second(
        'motor_commands', lambda now_ns: MotorCommand(now_ns, (1.0,) * 4)),)),
    'second publisher on wheel_states': Hazard(bound=0.07, faults=(second(
        'wheel_states', lambda now_ns: WheelSample(now_ns, (0.0,) * 4)),)),
    'second publisher on cmd_vel': Hazard(bound=0.13, faults=(second(
        'cmd_vel', lambda now_ns: VelocityCommand(now_ns, 1.4, 0.0)),)),
    'wheel_controller killed or stopped': Hazard(bound=0.31, faults=(stopped(CONTROLLER),)),
    'motor_driver killed or stopped': Hazard(bound=0.23, faults=(stopped(DRIVER),)),
    'host frozen': Hazard(bound=0.23, faults=(stopped(DRIVER, CONTROLLER),)),
    'cable unplugged': Hazard(bound=0.23, faults=(unplugged,)),
    'odom repeats one pose': following(bound=1.07, faults=(odom(0.0),)),
    'odom creeps at 2.5 cm/s': following(bound=1.07, faults=(odom(0.025),)),
    'odom runs backward': following(bound=0.91, faults=(odom(-0.3),)),
    'odom ends': following(bound=0.92, faults=(odom(None),)),
    'second publisher on path': following(bound=0.47, faults=(second_path,)),
    'trajectory_controller killed or stopped': following(bound=0.41, faults=(stopped(FOLLOWER),)),
}


def worst(name: str, rate: float, runs: int) -> tuple[float, int]:
    """Return the longest stop time [s] of so many runs of a hazard, and the number of its run."""
    return max((HAZARDS[name].stop_time(conditions_of(name, number, rate), number), number)
               for number in range(runs))


def runs_of(name: str) -> int:
    """Return the number of runs in which a hazard occurs at all phases, at each board."""
    return PHASES * min(len(HAZARDS[name].faults), len(ADDRESSES))


def recorded() -> dict[str, dict[float, float]]:
    """Return hazard -> rate [Hz] -> longest stop time [s], from the table of the document."""
    text = DOCUMENT.read_text(encoding='utf-8').partition(BEGIN)[2].partition(END)[0]
    rows = [[cell.strip() for cell in line.strip('|').split('|')]
            for line in text.strip().splitlines()[2:]]
    return {name: dict(zip(RATES, map(float, cells))) for name, _, *cells in rows}


def table(found: Mapping[str, Mapping[float, float]]) -> str:
    """Return the table of the document."""
    head = ['hazard', 'bound [s]', *(f'{rate:g} Hz' for rate in RATES)]
    rows = [[name, f'{HAZARDS[name].bound:g}', *(f'{times[rate]:.3f}' for rate in RATES)]
            for name, times in found.items()]
    return '\n'.join(f'| {" | ".join(cells)} |' for cells in (head, ['---'] * len(head), *rows))


def sentence() -> str:
    """Return the bounds in the sentence of the README."""
    def longest_of(part: Callable[[str], bool]) -> float:
        return max(hazard.bound for name, hazard in HAZARDS.items() if part(name))

    return (f'within {longest_of(lambda name: not OTHERS.match(name)):g} s (lost encoder counts: '
            f'{longest_of(lambda name: "counts" in name):g} s, wrong odometry: '
            f'{longest_of(lambda name: name.startswith("odom")):g} s)')


def main() -> int:
    """Write the table of ``docs/safety.md`` and the sentence of the README."""
    jobs = [(name, rate) for name in HAZARDS for rate in RATES]
    with ProcessPoolExecutor() as pool:
        times = list(pool.map(longest, jobs))
    found: dict[str, dict[float, float]] = {name: {} for name in HAZARDS}
    for (name, rate), seconds in zip(jobs, times):
        found[name][rate] = seconds
    README.write_text(SENTENCE.sub(sentence(), README.read_text(encoding='utf-8')),
                      encoding='utf-8')
    before, rest = DOCUMENT.read_text(encoding='utf-8').split(BEGIN)
    DOCUMENT.write_text(f'{before}{BEGIN}\n{table(found)}\n{END}{rest.split(END)[1]}',
                        encoding='utf-8')
    return 0


def longest(job: tuple[str, float]) -> float:
    """Return the longest stop time [s] of a hazard at a rate, at all phases of all its faults."""
    name, rate = job
    return worst(name, rate, runs_of(name))[0]


if __name__ == '__main__':
    sys.exit(main())
