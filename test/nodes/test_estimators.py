# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Estimator nodes as processes: estimates, invalid and late messages."""

from __future__ import annotations

import itertools
import math

import pytest
from sensor_msgs.msg import JointState

from smart_tire.samples import (
    FRICTION_QUANTITIES, GroundState, ImuSample, NS_PER_S, TireSample, WheelSample)
from smart_tire.uncertain import Uncertain

pytestmark = pytest.mark.processes

START_NS = 1_700_000_000 * NS_PER_S
GRAVITY_UP = (0.0, 0.0, 9.81)  # m/s2, specific force when stationary
GRID_NS = 8_000_000


def publish_stationary(graph, seconds=1.0, start_ns=START_NS, wheel_speed=0.0):
    """Publish inputs of a robot that does not move; its wheels may spin."""
    for tick in range(1, round(100 * seconds)):
        stamp_ns = start_ns + tick * 10_000_000
        graph.publish('imu/data', ImuSample(stamp_ns, GRAVITY_UP, (0.0, 0.0, 0.0)))
        if tick % 5 == 0:
            angle = wheel_speed * tick * 0.01
            graph.publish('wheel_states', WheelSample(stamp_ns, (wheel_speed,) * 4, (angle,) * 4))
        if tick % 2 == 0:
            graph.spin()  # about real time


def connect(graph, node, **samples):
    """Publish ``samples`` until ``node`` has received each: all subscriptions have matched."""
    def received(name):
        return graph.value(node, f'{name}.last_message_age') not in ('', 'inf')

    def publish():
        for name, sample in samples.items():
            graph.publish(name.replace('__', '/'), sample)

    graph.until(lambda: all(received(name.replace('__', '/')) for name in samples), publish)


@pytest.fixture
def slip(graph):
    graph.subscribe('odom', 'wheel_slip', 'icr')
    with graph.start('slip_estimator') as node:
        connect(graph, 'slip_estimator', wheel_states=WheelSample(START_NS, (0.0,) * 4),
                imu__data=ImuSample(START_NS, GRAVITY_UP, (0.0, 0.0, 0.0)))
        yield node
        assert node.end() == 0
        assert 'Traceback' not in node.output


def test_odometry_and_slip_are_published_at_every_grid_instant(graph, slip):
    publish_stationary(graph)
    graph.until(lambda: len(graph.received['odom']) >= 115
                and len(graph.received['wheel_slip']) >= 115)
    for name in ('odom', 'wheel_slip'):
        stamps = [sample.stamp_ns for sample in graph.samples(name)]
        assert {stamp % GRID_NS for stamp in stamps} == {0}
        assert {b - a for a, b in zip(stamps, stamps[1:])} == {GRID_NS}
    message = graph.received['odom'][-1]
    assert (message.header.frame_id, message.child_frame_id) == ('odom', 'base_link')
    assert all(math.isnan(ratio) for ratio in graph.samples('wheel_slip')[-1].ratio)
    assert not graph.received['icr']


def test_reset_odometry_moves_the_origin_of_odom_to_the_robot(graph, slip):
    publish_stationary(graph)
    graph.until(lambda: graph.received['odom'])
    assert graph.call('std_srvs/srv/Trigger', 'reset_odometry').success
    count_before = len(graph.received['odom'])
    publish_stationary(graph, 0.3, START_NS + NS_PER_S)
    graph.until(lambda: len(graph.received['odom']) > count_before + 20)
    assert graph.samples('odom')[-1].position == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)


def test_late_and_invalid_messages_are_counted_and_the_estimator_continues(graph, slip):
    publish_stationary(graph)
    graph.until(lambda: len(graph.received['odom']) > 110)
    graph.publish('imu/data', ImuSample(START_NS + 500_000_000, GRAVITY_UP, (0.0, 0.0, 0.0)),
                  ImuSample(START_NS + NS_PER_S, (math.nan, 0.0, 9.81), (0.0, 0.0, 0.0)))
    graph.publish_message('wheel_states', JointState(name=['front_left'], velocity=[0.0]))
    graph.until(lambda: graph.value('slip_estimator', 'frames_bad') == '2')
    assert graph.value('slip_estimator', 'late_messages') == '1'
    assert 'imu/data: 1 messages rejected, latest: linear_acceleration is [nan' in slip.output
    assert 'expected each of front_left, front_right' in slip.output
    count_before = len(graph.received['odom'])
    publish_stationary(graph, 0.5, START_NS + NS_PER_S)
    graph.until(lambda: len(graph.received['odom']) > count_before + 40)


def test_inputs_without_messages_are_named_in_the_diagnostics(graph, slip):
    graph.until(lambda: 'no imu/data; no wheel_states' in graph.status_message('slip_estimator'))
    assert 'ground_state' not in graph.status_message('slip_estimator')  # optional


def test_the_slip_estimator_awaits_ground_state_while_it_flows(graph):
    def ground(milliseconds):
        return GroundState(START_NS + milliseconds * 1_000_000, Uncertain(50.0, 2.0),
                           rolling_resistance=Uncertain(0.02, 0.01))

    def reached():
        latest = max((sample.stamp_ns for sample in graph.samples('odom')), default=START_NS)
        return (latest - START_NS) / NS_PER_S

    graph.subscribe('odom')
    with graph.start('slip_estimator') as node:
        connect(graph, 'slip_estimator', wheel_states=WheelSample(START_NS, (0.0,) * 4),
                imu__data=ImuSample(START_NS, GRAVITY_UP, (0.0, 0.0, 0.0)), ground_state=ground(0))
        publish_stationary(graph, 1.5)
        graph.until(lambda: reached() > 0.78)
        graph.until(lambda: graph.value('slip_estimator', 'ground') == 'given')
        assert reached() < 0.8  # the next ground_state takes effect then
        graph.publish('ground_state', ground(500), ground(1000))
        graph.until(lambda: reached() > 1.44)
        graph.publish('ground_state', ground(200))
        graph.until(lambda: graph.value('slip_estimator', 'ground_state.late_messages') == '1')
        publish_stationary(graph, 1.5, START_NS + 3 * NS_PER_S // 2)
        graph.until(lambda: reached() > 2.94)  # silence is awaited no longer than 0.9 s
        assert node.end() == 0
        assert 'Traceback' not in node.output


def film_volts(time, wheel_speed=6.0, radius=0.087, peak=0.8):
    """Return the voltage of a film that enters the contact patch at ``time`` 0 [s]."""
    position = wheel_speed * radius * time / 0.02  # film lengths
    return 1.65 + (peak if 0.0 < position < 2.3 else -peak * math.exp(2.3 - position)
                   if position >= 2.3 else 0.0)


def test_the_friction_estimator_uses_all_inputs_and_rejects_invalid_ones(graph):
    graph.subscribe('tire_friction', 'ground_state')
    with graph.start('friction_estimator') as node:
        connect(graph, 'friction_estimator', wheel_states=WheelSample(START_NS, (6.0,) * 4),
                tire_samples=TireSample(START_NS, 'front_right', (1.65, 1.65)),
                imu__data=ImuSample(START_NS, GRAVITY_UP, (0.0, 0.0, 0.0)))
        before = int(graph.value('friction_estimator', 'frames_ok'))
        bad = JointState(name=['front_right_pvdf_1'], position=[math.nan])
        bad.header.frame_id = 'front_right'
        graph.publish_message('tire_samples', bad)
        for tick in range(1, 1601):
            stamp_ns = START_NS + tick * 2_500_000
            time = tick * 2.5e-3 % (2.0 * math.pi / 6.0)  # s, since the start of the revolution
            graph.publish('tire_samples', TireSample(stamp_ns, 'front_right', (
                film_volts(time - 0.2), film_volts(time - 0.2 - 0.03 / (6.0 * 0.087)))))
            if tick % 25 == 0:
                angle = 6.0 * tick * 2.5e-3
                graph.publish('wheel_states', WheelSample(stamp_ns, (6.0,) * 4, (angle,) * 4))
            if tick % 4 == 0:
                graph.publish('imu/data', ImuSample(stamp_ns, GRAVITY_UP, (0.0, 0.0, 0.0)))
            if tick % 8 == 0:
                graph.spin()  # about real time
        graph.until(lambda: int(graph.value('friction_estimator', 'frames_ok')) >= before + 2064
                    and graph.value('friction_estimator', 'frames_bad') == '1')
        assert 'position is [nan' in node.output
        graph.until(lambda: graph.received['tire_friction'] and graph.received['ground_state'])
        graph.until(lambda: '+-' in graph.value('friction_estimator', 'ground.stiffness'))
        assert graph.value('friction_estimator', 'ground') == 'known'
        assert not graph.node.count_subscribers('odom')
        assert node.end() == 0
        assert 'Traceback' not in node.output
    for message in graph.received['tire_friction']:
        assert message.header.frame_id == 'front_right'
        assert tuple(message.name) == FRICTION_QUANTITIES
    assert {ground.stamp_ns % (NS_PER_S // 2) for ground in graph.samples('ground_state')} == {0}


def test_odometry_is_used_only_while_an_imu_is_missing(graph):
    stamps = itertools.count(START_NS, 10_000_000)
    with graph.start('friction_estimator') as node:
        graph.until(lambda: graph.node.count_subscribers('odom'), lambda: graph.publish(
            'wheel_states', WheelSample(next(stamps), (0.0,) * 4)))
        assert 'no imu/data: the motion is that of odom' in node.output
        graph.until(lambda: not graph.node.count_subscribers('odom'), lambda: graph.publish(
            'imu/data', ImuSample(next(stamps), GRAVITY_UP, (0.0, 0.0, 0.0))))
        assert node.end() == 0
        assert 'Traceback' not in node.output


def test_joints_of_other_names_are_given_by_parameters_or_recognized(graph):
    def wheel_states(**speeds):
        msg = JointState(name=['arm', *speeds], velocity=[9.0, *speeds.values()])
        msg.header.stamp.sec = START_NS // NS_PER_S
        return msg

    graph.connect('wheel_states', JointState, readers=0)
    arm = JointState(name=['arm'], velocity=[9.0])
    with graph.start('slip_estimator', joints__left='M1', joints__right='M2'), \
            graph.start('friction_estimator') as guess:
        def accepted(node, **speeds):
            def publish():
                graph.publish_message('wheel_states', wheel_states(**speeds))
                graph.publish_message('wheel_states', arm)
            graph.until(lambda: graph.value(node, 'wheel_states.last_message_age')
                        not in ('', 'inf'), publish)

        accepted('slip_estimator', M1=1.0, M2=2.0)
        accepted('friction_estimator', left_wheel=1.0, right_wheel=2.0)
        graph.until(lambda: 'the wheels are the joints left_wheel, right_wheel' in guess.output)
