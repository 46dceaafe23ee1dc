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
Measure the stop time of the wheels for each hazard of docs/safety.md; print a table.

``make stop-times`` runs it: real processes with emulated motor boards, on an idle machine and with
one busy process per core. Times are from the fault to zero duty at the motors. A time above the
bound fails only if it is also above it without the time that the processes waited on run queues.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
import io
import os
from pathlib import Path
import signal
import statistics
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from smart_tire.cli._stack import isolated_environment  # noqa: E402
from smart_tire.samples import MotorCommand, VelocityCommand, WheelSample  # noqa: E402
from support.following_rig import FollowingRig  # noqa: E402
from support.hazards import HAZARDS  # noqa: E402
from support.motor_boards import STILL  # noqa: E402
from support.robot_rig import Releases, RobotRig, Stranger  # noqa: E402
from support.verdict import MAX_TRIALS, Verdict, verdict  # noqa: E402

Scenario = Callable[[RobotRig, Path], float]  # returns the seconds from the fault to zero duty


def fails(**faults: object) -> Scenario:
    """Return a scenario in which the boards get ``faults``."""
    return lambda robot, _: robot.until_stopped(robot.rig.fail(**faults))


def restarts(robot: RobotRig, _: Path) -> float:
    """Restart the rear board."""
    restarted = robot.rig.restart(129)
    robot.graph.until(lambda: robot.rig.state().timeouts == (2, 2), robot.command)
    return robot.rig.record(restarted).first_zero() - restarted


def commands_end(robot: RobotRig, _: Path) -> float:
    """Stop commanding."""
    robot.hold(0.06)
    robot.command()
    return robot.until_stopped(time.monotonic(), lambda: None)


def commands_are_nan(robot: RobotRig, _: Path) -> float:
    """Command NaN instead of a velocity."""
    robot.hold(0.06)
    robot.command()
    return robot.until_stopped(time.monotonic(), lambda: robot.publish_twist(float('nan')))


def stop(robot: RobotRig, _: Path) -> float:
    """Call the emergency stop."""
    asked = time.monotonic()
    assert robot.emergency_stop(True).success
    return robot.rig.record(asked).first_zero() - asked


def slowly(**faults: object) -> Scenario:
    """Return a scenario in which the boards get ``faults`` at 0.1 m/s."""
    def run(robot: RobotRig, _: Path) -> float:
        robot.hold(1.0, lambda: robot.command(0.1))
        return robot.until_stopped(robot.rig.fail(**faults), lambda: robot.command(0.1))
    return run


def constant_duty(robot: RobotRig, _: Path) -> float:
    """Freeze an encoder while every motor has a duty of 0.15, without the wheel controller."""
    robot.processes.pop('wheel_controller').end()
    robot.pause()

    def command() -> None:
        robot.graph.publish('motor_commands', MotorCommand(time.time_ns(), (0.15,) * 4))

    robot.hold(2.0, command)
    return robot.until_stopped(robot.rig.fail(frozen={1}), command)


def queued(robot: RobotRig, _: Path) -> float:
    """Stop the driver and resume it 0.45 s later; from the latest command to the last duty."""
    robot.drive()
    latest = time.monotonic()
    robot.processes['motor_driver'].popen.send_signal(signal.SIGSTOP)
    robot.processes['wheel_controller'].popen.send_signal(signal.SIGSTOP)
    robot.hold(0.45)
    robot.processes['motor_driver'].popen.send_signal(signal.SIGCONT)
    robot.hold(0.5)
    return float(max(when for when, duty in robot.rig.record(latest).duties
                     if duty == STILL)) - latest


def released_repeatedly(robot: RobotRig, _: Path) -> float:
    """Call the emergency stop while another client releases it 500 times a second."""
    with Releases(robot) as releases:
        robot.graph.until(lambda: releases.answered > 100, robot.command)
        robot.drive()
        asked = time.monotonic()
        assert robot.emergency_stop(True).success
        robot.stay_stopped(1.5)
        return robot.rig.record(asked).first_zero() - asked


def second(topic: str, make: Callable[[], object]) -> Scenario:
    """Return a scenario in which another node publishes on ``topic`` too."""
    def run(robot: RobotRig, folder: Path) -> float:
        with Stranger(folder, topic) as stranger:
            robot.drive()
            robot.graph.until(  # its existence is a warning
                lambda: any('publishers exist' in robot.status_message(node)
                            for node in ('motor_driver', 'wheel_controller')), robot.command)

            def both() -> None:
                robot.command()
                stranger.publish(make())

            began = time.monotonic()
            both()
            return robot.until_stopped(began, both)
    return run


def signals(number: signal.Signals, *names: str) -> Scenario:
    """Return a scenario in which processes receive a signal."""
    def run(robot: RobotRig, _: Path) -> float:
        began = time.monotonic()
        for name in names:
            robot.processes[name].popen.send_signal(number)
        return robot.until_stopped(began)
    return run


def unplugged(robot: RobotRig, _: Path) -> float:
    """Unplug the cable."""
    return robot.until_stopped(robot.rig.unplug())


def odom_moves(speed: float) -> Scenario:
    """Return a scenario in which ``odom`` moves with ``speed`` [m/s], unlike the wheels."""
    def run(robot: RobotRig, _: Path) -> float:
        assert isinstance(robot, FollowingRig)
        robot.odom_speed = speed
        return robot.until_stopped(time.monotonic())
    return run


def second_path(robot: RobotRig, folder: Path) -> float:
    """Publish a path from another node."""
    assert isinstance(robot, FollowingRig)
    with Stranger(folder, 'path') as stranger:
        robot.drive()
        began = time.monotonic()
        stranger.publish(robot.path())
        return robot.until_stopped(began)


FOLLOWING: Mapping[str, Scenario] = {  # the same, while a path is followed
    'odom repeats one pose': odom_moves(0.0),
    'odom creeps at 2.5 cm/s': odom_moves(0.025),
    'second publisher on path': second_path,
}

SCENARIOS: Mapping[str, Scenario] = {  # hazard, as in HAZARDS -> scenario
    'replies of both boards lost': fails(mute={128, 129}),
    'replies of one board lost': fails(mute={129}),
    'replies of both boards garbled': fails(garbled={128, 129}),
    'line flooded towards the host': fails(flood=True),
    'requests garbled': fails(deaf=True),
    'encoder frozen': fails(frozen={1}),
    'encoder channel open': fails(toggling={1}),
    'encoder channel open at 0.1 m/s': slowly(toggling={1}),
    'encoder frozen at 0.1 m/s': slowly(frozen={1}),
    'encoder frozen in open loop at duty 0.15': constant_duty,
    'encoder loses 80 % of its counts': fails(losing={1: 0.8}),
    'encoder or motor reversed': fails(reversed={2}),
    'board restarted': restarts,
    'board status not normal': fails(status={128: 4}),
    'supply low': fails(supply={129: 90}),
    'cmd_vel ends': commands_end,
    'cmd_vel becomes NaN': commands_are_nan,
    'emergency stop': stop,
    'emergency stop, released 500 times a second': released_repeatedly,
    'queued motor_commands': queued,
    'second publisher on motor_commands': second('motor_commands', lambda: MotorCommand(
        time.time_ns(), (1.0, 1.0, 1.0, 1.0))),
    'second publisher on wheel_states': second('wheel_states', lambda: WheelSample(
        time.time_ns(), (0.0, 0.0, 0.0, 0.0))),
    'second publisher on cmd_vel': second('cmd_vel', lambda: VelocityCommand(
        time.time_ns(), 1.4, 0.0)),
    'motor_driver killed or stopped': signals(signal.SIGKILL, 'motor_driver'),
    'wheel_controller killed or stopped': signals(signal.SIGSTOP, 'wheel_controller'),
    'host frozen': signals(signal.SIGSTOP, 'motor_driver', 'wheel_controller'),
    'cable unplugged': unplugged,
}


@contextmanager
def load(busy: bool) -> Iterator[None]:
    """Keep every core busy in this context if ``busy``."""
    spin = [sys.executable, '-c', 'while True: pass']
    children = [subprocess.Popen(spin) for _ in range((os.cpu_count() or 1) * busy)]
    try:
        yield
    finally:
        for child in children:
            child.kill()
            child.wait()


def judge(name: str, scenario: Scenario, rig: type[RobotRig]) -> tuple[float, Verdict]:
    """Return the stop time [s] with new processes, and its verdict; repeat the unclear."""
    for _ in range(MAX_TRIALS):
        with (redirect_stdout(io.StringIO()),  # of the nodes, at the end
              tempfile.TemporaryDirectory() as folder, rig(Path(folder)) as robot):
            robot.drive()
            queues = robot.run_queues()
            seconds = scenario(robot, Path(folder))
            found = verdict(seconds, queues.seconds(), HAZARDS[name].bound)
        if found is not Verdict.INCONCLUSIVE:
            break
    return seconds, found


def main() -> int:
    """Measure and print; return 1 if a bound is exceeded."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--runs', type=int, default=5, help='per hazard (default: %(default)s)')
    parser.add_argument('--only', default='', help='hazards that contain this text')
    args = parser.parse_args()
    os.environ.update(isolated_environment())
    os.environ['PYTHONPATH'] = str(Path(__file__).resolve().parents[2])
    os.environ.pop('_ROS_WHEELS_BOOTSTRAP_COMPLETE', None)
    failed = False
    print('| hazard | bound [s] | idle: median, longest [s] | cores loaded [s] |\n|' + '---|' * 4)
    for name, scenario in {**SCENARIOS, **FOLLOWING}.items():
        if args.only not in name:
            continue
        rig, cells = FollowingRig if name in FOLLOWING else RobotRig, []
        for busy in (False, True):
            with load(busy):
                runs = [judge(name, scenario, rig) for _ in range(args.runs)]
            times = [seconds for seconds, _ in runs]
            unclear = sum(found is Verdict.INCONCLUSIVE for _, found in runs)
            failed = failed or any(found is Verdict.FAIL for _, found in runs)
            cells.append(f'{statistics.median(times):.3f}, {max(times):.3f}'
                         + f' ({unclear} inconclusive)' * bool(unclear))
        print(f'| {name} | {HAZARDS[name].bound:g} | {" | ".join(cells)} |', flush=True)
    return int(failed)


if __name__ == '__main__':
    sys.exit(main())
