# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Commands that end, are old or invalid: stop times at the boards."""

from __future__ import annotations

from collections.abc import Iterator
import math
import signal
import time

import pytest
from smart_tire.samples import NS_PER_S
from support.robot_rig import RobotRig

pytestmark = pytest.mark.safety

CMD_VEL_TIMEOUT = 0.25  # s, the default
COMMAND_TIMEOUT = 0.25  # s, the default of motor_driver
HOUR = 3600 * NS_PER_S


@pytest.fixture(scope='module')
def robot(tmp_path_factory, isolated_ros) -> Iterator[RobotRig]:
    with RobotRig(tmp_path_factory.mktemp('commands')) as started:
        yield started


@pytest.fixture
def driving(robot):
    robot.drive()
    return robot


def last_command(robot):
    """Send a command and return the time."""
    robot.hold(0.06)
    robot.command()
    return time.monotonic()


def test_the_wheels_stop_when_commands_end_and_stay_stopped(driving):
    ended = last_command(driving)
    assert driving.until_stopped(ended, lambda: None) < CMD_VEL_TIMEOUT + 0.1
    driving.stay_stopped(1.0, lambda: None)


def test_commands_at_a_low_rate_drive_the_wheels_without_interruption(driving):
    def command_slowly():
        end = time.monotonic() + 1.5
        while time.monotonic() < end:
            driving.command()
            driving.hold(0.17)

    driving.keep_driving(command_slowly)


@pytest.mark.parametrize('v_x', [math.nan, math.inf, -math.inf, 1e308, 1e3])
def test_an_invalid_velocity_is_refused_and_the_previous_command_expires(driving, v_x):
    bad = int(driving.graph.value('wheel_controller', 'frames_bad'))
    ended = last_command(driving)
    assert driving.until_stopped(ended, lambda: driving.publish_twist(v_x)) < CMD_VEL_TIMEOUT + 0.1
    driving.graph.until(
        lambda: int(driving.graph.value('wheel_controller', 'frames_bad')) > bad)


@pytest.mark.parametrize('stamp_ns', [-HOUR, HOUR, -600_000_000, 600_000_000])
def test_a_command_from_the_past_or_future_moves_no_wheel(robot, stamp_ns):
    robot.pause()
    robot.stay_stopped(0.6, lambda: robot.command(stamp_ns=time.time_ns() + stamp_ns))
    robot.graph.until(lambda: 'expected at most 0.5 s' in robot.status_message('wheel_controller'),
                      lambda: robot.command(stamp_ns=time.time_ns() + stamp_ns))


def test_a_command_with_a_negative_timestamp_moves_no_wheel(robot):
    robot.pause()
    robot.stay_stopped(0.6, lambda: robot.command(stamp_ns=-NS_PER_S))


@pytest.mark.parametrize('stamp_ns', [-400_000_000, 400_000_000])
def test_a_small_clock_offset_of_the_commander_is_accepted(robot, stamp_ns):
    robot.pause()
    robot.graph.until(lambda: not robot.rig.state().still,
                      lambda: robot.command(stamp_ns=time.time_ns() + stamp_ns))


def test_commands_without_a_timestamp_drive_with_one_warning(robot):
    robot.pause()
    robot.graph.until(lambda: min(robot.rig.state().duty) > 0.2,
                      lambda: robot.command(stamp_ns=0))
    ended = time.monotonic()
    assert robot.until_stopped(ended, lambda: None) < CMD_VEL_TIMEOUT + 0.1
    assert robot.processes['wheel_controller'].output.count('cmd_vel has no timestamp') == 1


@pytest.mark.parametrize('stamped', [True, False])
def test_commands_queued_while_the_controller_was_stopped_move_no_wheel(driving, stamped):
    controller = driving.processes['wheel_controller'].popen
    controller.send_signal(signal.SIGSTOP)
    stopped = time.monotonic()
    assert driving.until_stopped(stopped, lambda: driving.command(
        stamp_ns=None if stamped else 0)) < COMMAND_TIMEOUT + 0.1
    driving.hold(1.5, lambda: driving.command(stamp_ns=None if stamped else 0))
    driving.hold(0.6)  # the latest of them is old now
    since = time.monotonic()
    controller.send_signal(signal.SIGCONT)
    driving.stay_stopped(1.0, lambda: None)
    assert not driving.rig.record(since).driven()
