# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Old and invalid duties, at a driver without a controller."""

from __future__ import annotations

from collections.abc import Iterator
import math
import signal
import time

import pytest
from sensor_msgs.msg import JointState
from smart_tire.samples import MotorCommand, NS_PER_S, WHEELS
from support.robot_rig import RobotRig

pytestmark = pytest.mark.safety

HOUR = 3600 * NS_PER_S
LATENCY = 0.05  # s, from the expiry of a duty to zero at the motors, on a busy machine


@pytest.fixture(scope='module')
def driver(tmp_path_factory, isolated_ros) -> Iterator[RobotRig]:
    with RobotRig(tmp_path_factory.mktemp('driver'), controller=False) as started:
        yield started


def duties(robot, value, stamp_ns=0):
    """Publish motor_commands as wheel_controller would."""
    robot.graph.publish('motor_commands', MotorCommand(stamp_ns, (value,) * 4))


@pytest.mark.parametrize('duty', [math.nan, math.inf, 1e308, 1.5])
def test_the_driver_refuses_an_invalid_duty(driver, duty):
    driver.pause()
    rejected = int(driver.graph.value('motor_driver', 'motor_commands.rejected') or 0)
    bad = JointState(name=list(WHEELS), effort=[0.5, duty, 0.5, 0.5])
    driver.stay_stopped(0.6, lambda: driver.graph.publish_message('motor_commands', bad))
    driver.graph.until(lambda: int(
        driver.graph.value('motor_driver', 'motor_commands.rejected')) > rejected)


@pytest.mark.parametrize('age_ns', [-HOUR, HOUR, 700_000_000])
def test_the_driver_refuses_a_duty_from_the_past_or_future(driver, age_ns):
    driver.pause()
    driver.stay_stopped(0.6, lambda: duties(driver, 0.5, time.time_ns() - age_ns))
    # a duty stamped now drives: the timestamp was the reason
    driver.graph.until(lambda: min(driver.rig.state().duty) > 0.4,
                       lambda: duties(driver, 0.5, time.time_ns()))


@pytest.mark.parametrize('age', [0.2, 0.24, 0.3, 0.45])
def test_the_time_out_of_a_duty_counts_from_its_timestamp(driver, age):
    driver.graph.until(lambda: min(driver.rig.state().duty) > 0.4,
                       lambda: duties(driver, 0.5, time.time_ns()))
    driver.pause()
    sent, stamp_ns = time.monotonic(), time.time_ns() - round(age * NS_PER_S)
    duties(driver, 0.5, stamp_ns)
    driver.hold(0.4)
    driven = [when for when, duty in driver.rig.record(sent).duties if min(duty) > 0.4]
    assert all(when - sent < 0.25 - age for when in driven)
    assert not driver.rig.record(max(sent + 0.25 - age, sent) + LATENCY).driven()


def test_duties_queued_for_less_than_their_maximum_age_move_no_wheel(driver):
    driver.graph.until(lambda: min(driver.rig.state().duty) > 0.4,
                       lambda: duties(driver, 0.5, time.time_ns()))
    process = driver.processes['motor_driver'].popen
    process.send_signal(signal.SIGSTOP)
    stopped = time.monotonic()
    assert driver.until_stopped(stopped, lambda: duties(driver, 0.5, time.time_ns())) < 0.3
    driver.hold(0.27)
    resumed = time.monotonic()
    process.send_signal(signal.SIGCONT)
    driver.hold(0.6)
    assert not driver.rig.record(resumed).driven()


def test_duties_without_a_timestamp_drive(driver):
    driver.pause()
    driver.graph.until(lambda: min(driver.rig.state().duty) > 0.4, lambda: duties(driver, 0.5))


def test_duties_queued_while_the_driver_was_stopped_move_no_wheel(driver):
    driver.graph.until(lambda: min(driver.rig.state().duty) > 0.4, lambda: duties(driver, 0.5))
    process = driver.processes['motor_driver'].popen
    process.send_signal(signal.SIGSTOP)
    stopped = time.monotonic()
    assert driver.until_stopped(stopped, lambda: duties(driver, 0.5)) < 0.5
    driver.hold(1.0, lambda: duties(driver, 0.5))
    driver.hold(0.6)
    process.send_signal(signal.SIGCONT)
    driver.stay_stopped(0.8, lambda: None)
