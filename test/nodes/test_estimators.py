# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Estimator nodes: estimates, invalid and late messages."""

from __future__ import annotations

import math

import pytest
from sensor_msgs.msg import Imu, JointState

from smart_tire.messages import imu_to_msg
from smart_tire.nodes.friction_estimator import FrictionEstimatorNode
from smart_tire.nodes.lockstep import TOPIC
from smart_tire.nodes.slip_estimator import SlipEstimatorNode
from smart_tire.samples import (
    FRICTION_QUANTITIES, GroundState, ImuSample, NS_PER_S, TireSample, WheelSample)
from smart_tire.uncertain import Uncertain
from support.virtual_node import virtual

pytestmark = pytest.mark.processes

START_NS = 1_700_000_000 * NS_PER_S
GRAVITY_UP = (0.0, 0.0, 9.81)  # m/s2, specific force when stationary
GRID_NS = 8_000_000
NAN = math.nan


def stationary(stamp_ns):
    """Return a sample of an IMU that does not move."""
    return ImuSample(stamp_ns, GRAVITY_UP, (0.0, 0.0, 0.0))


def stand(node, seconds=1.0, start_ns=START_NS):
    """Hand the inputs of a robot that does not move to the node."""
    for tick in range(round(100 * seconds)):
        stamp_ns = start_ns + tick * 10_000_000
        node.publish('imu/data', stationary(stamp_ns))
        if tick % 5 == 0:
            node.publish('wheel_states', WheelSample(stamp_ns, (0.0,) * 4, (0.0,) * 4))
        node.run(0.01)


def reached(node):
    """Return the time of the latest odometry [s]."""
    return (node.latest('odom').stamp_ns - START_NS) / NS_PER_S


@pytest.fixture
def slip(isolated_ros):
    with virtual(SlipEstimatorNode) as node:
        yield node


@pytest.mark.parametrize('share, logged', [(0.21, False), (0.19, True)])
def test_a_gyro_bias_known_to_a_fifth_of_its_prior_is_logged_once(
        slip, monkeypatch, share, logged):
    bias = Uncertain(0.001, share * slip.params.robot.imu.gyro_bias)
    monkeypatch.setattr(type(slip.estimator), 'gyro_bias', bias)
    for _ in range(2):
        slip.health()
    assert sum('initialized: gyro bias +0.0010' in line for line in slip.log.lines) == logged


def test_values_of_the_imu_that_are_called_not_measured_are_in_the_diagnostics(slip):
    read = slip.conversion('imu/data', slip.params.robot.joints)
    for covariance, said in ((0.0, False), (-1.0, True)):
        msg = imu_to_msg(Imu(), stationary(START_NS))
        msg.linear_acceleration_covariance[0] = covariance
        assert read(msg) == stationary(START_NS)
        text = 'imu/data: linear_acceleration: covariance -1, not measured (REP-145)'
        assert (text in slip.health().message) is said


def test_a_replay_is_in_the_diagnostics_until_its_replayer_is_gone(slip):
    slip._follower._reset('/replayer', 'run')
    slip.publishers_of[TOPIC], slip.types_of[TOPIC] = {b'1': 'replayer'}, 'std_msgs/msg/String'
    assert slip.health().values['replay'] == '/replayer'
    slip.publishers_of.clear()
    assert 'replay' not in slip.health().values
    assert '/replayer ended during a replay' in slip.log.lines[-1]


def test_odometry_and_slip_are_published_at_every_grid_instant(slip):
    stand(slip)
    for name in ('odom', 'wheel_slip'):
        stamps = [sample.stamp_ns for sample in slip.samples(name)]
        assert len(stamps) > 110
        assert {stamp % GRID_NS for stamp in stamps} == {0}
        assert {b - a for a, b in zip(stamps, stamps[1:])} == {GRID_NS}
    message = slip.received['odom'][-1]
    assert (message.header.frame_id, message.child_frame_id) == ('odom', 'base_link')
    assert all(math.isnan(ratio) for ratio in slip.latest('wheel_slip').ratio)
    assert not slip.received['icr']


def test_odometry_is_thinned_and_its_numbers_are_those_of_the_full_rate(isolated_ros):
    found = {}
    for rate in (125.0, 50.0):
        with virtual(SlipEstimatorNode, odom_rate=rate) as node:
            stand(node)
            found[rate] = node.samples('odom')
            slips = len(node.samples('wheel_slip'))
    assert len(found[50.0]) > 35 and slips == len(found[125.0])
    assert found[50.0] == [one for one in found[125.0] if one.stamp_ns % (3 * GRID_NS) == 0]


def test_increments_are_published_and_none_leads_over_a_reset(isolated_ros):
    with virtual(SlipEstimatorNode, odom_twist='increments') as node:
        stand(node)
        assert node.call('reset_odometry').success
        stand(node, 0.3, START_NS + NS_PER_S)
        assert max(abs(one.linear[0]) for one in node.samples('odom')) < 0.01
        assert len(node.samples('odom')) > 130


def test_reset_odometry_moves_the_origin_of_odom_to_the_robot(slip):
    stand(slip)
    assert slip.call('reset_odometry').success
    stand(slip, 0.3, START_NS + NS_PER_S)
    assert reached(slip) > 1.2
    assert slip.latest('odom').position == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)


def test_late_and_invalid_messages_are_counted_and_the_estimator_continues(slip):
    stand(slip)
    slip.publish('imu/data', stationary(START_NS + NS_PER_S // 2),
                 ImuSample(START_NS + NS_PER_S, (NAN, 0.0, 9.81), (0.0, 0.0, 0.0)))
    slip.publish('wheel_states', JointState(name=['front_left'], velocity=[0.0]))
    values = slip.health().values
    assert (values['frames_bad'], values['late_messages']) == ('2', '1')
    log = str(slip.log.lines)
    assert 'imu/data: 1 messages rejected, latest: linear_acceleration is [nan' in log
    assert 'expected each of front_left, front_right' in log
    stand(slip, 0.5, START_NS + NS_PER_S)
    assert reached(slip) > 1.4


@pytest.mark.parametrize('velocity', [(), (0.0,) * 4])
def test_wheels_without_velocities_are_read_by_their_angles(slip, velocity):
    for tick in range(250):
        stamp_ns = START_NS + tick * 10_000_000
        slip.publish('imu/data', stationary(stamp_ns))
        if tick % 5 == 0:
            msg = JointState(name=['front_left', 'front_right', 'rear_left', 'rear_right'],
                             position=[0.05 * tick] * 4, velocity=velocity)
            msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(stamp_ns, NS_PER_S)
            slip.publish('wheel_states', msg)
        slip.run(0.01)
    speed = 5.0 * slip.params.robot.wheel_radius  # m/s
    assert slip.latest('odom').linear[0] == pytest.approx(speed, abs=0.1 * speed)
    assert int(slip.health().values[
        f'wheel_states.{"zero" if velocity else "missing"}_velocity']) > 35


def test_a_clock_that_is_set_is_in_the_log_and_the_pose_goes_on(slip):
    stand(slip)
    slip.estimator._segment.filter.kalman.set_states([0], 7.0, 0.1)
    slip.run(0.1)
    stand(slip, start_ns=START_NS + 2 * NS_PER_S)
    x = slip.latest('odom').position[0]
    stand(slip, start_ns=START_NS + 3600 * NS_PER_S)
    assert slip.latest('odom').position[0] == pytest.approx(x, abs=0.01) and x > 0.0
    slip.health()
    assert sum('the clock of the inputs was set' in line for line in slip.log.lines) == 1


def test_inputs_are_logged_in_one_line_each_and_those_without_messages_are_in_the_diagnostics(
        slip):
    slip.run(3.0)
    health = slip.health()
    assert 'no imu/data; no wheel_states' in health.message
    assert 'ground_state' not in health.message  # optional
    stand(slip, 10.0)
    waiting, first, *others = slip.log.lines
    assert waiting == 'waiting for imu/data, wheel_states (2 s)'
    assert first == 'first estimate: odom'
    assert sorted(line[:24] for line in others) == [
        'initialized: gyro bias +', 'receiving imu/data at 10', 'receiving wheel_states a']


def test_the_slip_estimator_awaits_ground_state_while_it_flows(slip):
    def ground(milliseconds):
        return GroundState(START_NS + milliseconds * 1_000_000, Uncertain(50.0, 2.0),
                           rolling_resistance=Uncertain(0.02, 0.01))

    slip.publish('ground_state', ground(0))
    stand(slip, 1.5)
    assert slip.health().values['ground'] == 'given'
    assert 0.78 < reached(slip) < 0.8  # the next ground_state takes effect then
    slip.publish('ground_state', ground(500), ground(1000))
    assert reached(slip) > 1.44
    slip.publish('ground_state', ground(200))
    assert slip.health().values['ground_state.late_messages'] == '1'
    stand(slip, 1.5, START_NS + 3 * NS_PER_S // 2)
    assert reached(slip) > 2.94  # silence is awaited no longer than 0.9 s


def film_volts(time, wheel_speed=6.0, radius=0.087, peak=0.8):
    """Return the voltage of a film that enters the contact patch at ``time`` 0 [s]."""
    position = wheel_speed * radius * time / 0.02  # film lengths
    return 1.65 + (peak if 0.0 < position < 2.3 else -peak * math.exp(2.3 - position)
                   if position >= 2.3 else 0.0)


@pytest.fixture
def friction(isolated_ros):
    with virtual(FrictionEstimatorNode) as node:
        yield node


def test_the_friction_estimator_uses_all_inputs_and_rejects_invalid_ones(friction):
    bad = JointState(name=['front_right_pvdf_1'], position=[NAN])
    bad.header.frame_id = 'front_right'
    friction.publish('tire_samples', bad)
    for tick in range(1600):
        stamp_ns = START_NS + tick * 2_500_000
        time = tick * 2.5e-3 % (2.0 * math.pi / 6.0)  # s, since the start of the revolution
        friction.publish('tire_samples', TireSample(stamp_ns, 'front_right', (
            film_volts(time - 0.2), film_volts(time - 0.2 - 0.03 / (6.0 * 0.087)))))
        if tick % 25 == 0:
            angle = 6.0 * tick * 2.5e-3
            friction.publish('wheel_states', WheelSample(stamp_ns, (6.0,) * 4, (angle,) * 4))
        if tick % 4 == 0:
            friction.publish('imu/data', stationary(stamp_ns))
    values = friction.health().values
    assert (values['frames_ok'], values['frames_bad']) == ('2064', '1')
    assert 'position is [nan' in friction.log.lines[0]
    assert '+-' in values['ground.stiffness']
    assert values['ground'] == 'known'
    assert not friction.receives('odom')
    for message in friction.received['tire_friction']:
        assert message.header.frame_id == 'front_right'
        assert tuple(message.name) == FRICTION_QUANTITIES
    stamps = {sample.stamp_ns for sample in friction.samples('ground_state')}
    assert {stamp % (NS_PER_S // 2) for stamp in stamps} == {0}


def test_odometry_is_used_only_while_an_imu_is_missing(friction):
    friction.run(10.0)
    assert not friction.receives('odom')
    for tick in range(50):
        friction.publish('wheel_states', WheelSample(START_NS + tick * 100_000_000, (0.0,) * 4))
        assert friction.receives('odom') == (tick >= 40)  # two checks, each after 2 s
        friction.run(0.1)
    assert 'no imu/data: the motion is that of odom' in str(friction.log.lines)
    friction.publish('imu/data', stationary(START_NS + 5 * NS_PER_S))
    friction.run(2.0)
    assert not friction.receives('odom')


@pytest.mark.parametrize(('node_class', 'joints', 'parameters'), [
    (SlipEstimatorNode, ('M1', 'M2'), {'joints__left': 'M1', 'joints__right': 'M2'}),
    (FrictionEstimatorNode, ('left_wheel', 'right_wheel'), {})])
def test_joints_of_other_names_are_given_by_parameters_or_recognized(
        isolated_ros, node_class, joints, parameters):
    message = JointState(name=['arm', *joints], velocity=[9.0, 1.0, 2.0])
    message.header.stamp.sec = START_NS // NS_PER_S
    with virtual(node_class, **parameters) as node:
        node.publish('wheel_states', message, JointState(name=['arm'], velocity=[9.0]))
        assert (node.inputs['wheel_states'].ok, node.inputs['wheel_states'].bad) == (1, 0)
        recognized = 'the wheels are the joints left_wheel, right_wheel' in str(node.log.lines)
        assert recognized == (not parameters)


@pytest.mark.parametrize('wheels, depth', [
    ('[]', 4000), ('[front_left]', 4000), ('[front_left, rear_left]', 8000)])
def test_films_are_awaited_and_queued_for_each_instrumented_wheel(isolated_ros, wheels, depth):
    with virtual(FrictionEstimatorNode, film__wheels=wheels) as node:
        assert node.profiles['tire_samples'].depth == depth
        assert node.inputs['tire_samples'].required == (wheels != '[]')
