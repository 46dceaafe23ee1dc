# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Driver nodes: from bytes on a port to messages."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from itertools import count
import time
from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from smart_tire.bags.cdr import empty
from smart_tire.drivers.serial_port import open_port
from smart_tire.messages import TYPED
from smart_tire.nodes import base
from smart_tire.nodes.compat import RCLError
from smart_tire.nodes.diagnostics import Status
from smart_tire.nodes.imu_driver import ImuDriver
from smart_tire.nodes.motor_driver import MotorDriver
from smart_tire.nodes.qos import latched
from smart_tire.nodes.tire_receiver import TireReceiver
from smart_tire.protocol import vectornav, vectornav_ascii, xsens
from smart_tire.protocol.tire_payload import encode_batch, TireBatch
from smart_tire.protocol.xbee import encode_frame, encode_receive_packet, ReceivePacket
from smart_tire.samples import ImuSample, MotorCommand
from std_msgs.msg import Bool
from support.robot_rig import RobotRig
from support.virtual_node import local

pytestmark = pytest.mark.processes

UNITS = {0x0013A20040A1B2C2: 'front_left', 0x0013A20040A1B2C3: 'front_right'}
UNITS_TEXT = '[' + ', '.join(f'"{address:016X}={wheel}"' for address, wheel in UNITS.items()) + ']'
BATCH = TireBatch(flags=0, sequence=0, timer_us=0, period_us=2500,
                  codes=((0, 512),) * 15 + ((1023, 511),), battery_mv=3700)
IMU = ImuSample(0, (0.5, -0.25, 9.8125), (0.125, 0.0, -0.5))


def packet(number, address, payload=b''):
    """Return the bytes of a sensor node's batch ``number``, or of another payload."""
    batch = replace(BATCH, sequence=number, timer_us=40_000 * number)
    return encode_frame(encode_receive_packet(
        ReceivePacket(address, 0xFFFE, 1, payload or encode_batch(batch))))


def imu_frame(protocol, index):
    """Return the bytes of a sample at 100 Hz."""
    if protocol == 'vectornav_binary':
        return vectornav.encode_frame(vectornav.encode_binary(index * 10_000_000, IMU))
    if protocol == 'xsens':
        return xsens.encode_message(xsens.encode_imu(index * 10_000_000, IMU))
    return vectornav_ascii.encode_sentence(vectornav_ascii.encode_ymr(IMU))


@contextmanager
def receiving(node_class, port, **parameters):
    """Yield a driver that has opened its port."""
    port.plug_in()
    with local(node_class, port=port.path, **parameters) as node:
        node.until(lambda: node.health().values['port_opened'] == '1')
        yield node


def test_a_batch_is_published_as_one_message_per_conversion(isolated_ros, port):
    with receiving(TireReceiver, port, units=UNITS_TEXT) as node:
        before, expected = time.time_ns(), 0
        lost, unknown_address = {5, 6}, 0x0013A200DEADBEEF
        for number in range(10):
            heard = [address for address in UNITS
                     if number not in lost or address != 0x0013A20040A1B2C2]
            port.write(b''.join(packet(number, address) for address in heard))
            expected += 16 * len(heard)
            node.until(lambda: len(node.received['tire_samples']) == expected)  # noqa: B023
        port.write(packet(9, 0x0013A20040A1B2C3) + packet(0, unknown_address)
                   + packet(0, 0x0013A20040A1B2C3, b'\x02' + bytes(80)))
        node.until(lambda: node.health().values['frames_bad'] == '2')
        node.until(lambda: 'no batches from front_left; no batches from front_right'
                   in node.health().message)
        values = node.health().values
        counts = {key: values[key] for key in (
            'frames_ok', 'batches_ok', 'batches_lost', 'batches_duplicate',
            'front_left.batches_lost', 'front_right.batches_lost')}
        assert counts == {'frames_ok': '19', 'batches_ok': '18', 'batches_lost': '2',
                          'batches_duplicate': '1', 'front_left.batches_lost': '2',
                          'front_right.batches_lost': '0'}
        assert 'bad frames, latest: ' in str(node.log.lines)
    assert [len(node.received[name]) for name in ('tire_samples', 'tire_battery')] == [expected, 2]
    for wheel in UNITS.values():
        samples = [sample for sample in node.samples('tire_samples') if sample.wheel == wheel]
        stamps = [sample.stamp_ns for sample in samples[:16]]
        assert np.diff(stamps) == pytest.approx(2_500_000)
        assert before - 100_000_000 < stamps[0] < stamps[-1] < time.time_ns()
        assert samples[15].volts == pytest.approx((3.3, 511 * 3.3 / 1023))
    (names,) = {tuple(message.name) for message in node.received['tire_samples']
                if message.header.frame_id == 'front_right'}
    assert names == ('front_right_pvdf_1', 'front_right_pvdf_2')


def test_a_batch_is_published_as_one_typed_message_while_someone_subscribes(
        isolated_ros, port, monkeypatch):
    monkeypatch.setattr(base, 'installed_class', lambda name: partial(empty, name))
    typed = TYPED['tire_samples']
    with receiving(TireReceiver, port, units=UNITS_TEXT) as node:
        for number, subscribers in enumerate((0, 1, 0)):
            node.subscribers[typed.name] = subscribers
            port.write(packet(number, 0x0013A20040A1B2C3))
            wanted = 16 * number + 16
            node.until(lambda: len(node.received['tire_samples']) == wanted)  # noqa: B023
    (batch,) = map(typed.from_msg, node.received[typed.name])
    assert batch.samples == node.samples('tire_samples')[16:32]
    assert (batch.wheel, batch.saturated) == ('front_right', False)


@pytest.mark.parametrize('protocol', ['vectornav_binary', 'vectornav_ascii', 'xsens'])
def test_imu_samples_are_in_rep_103_axes_for_every_protocol(protocol, isolated_ros, port):
    with receiving(ImuDriver, port, protocol=protocol, imu__gyro_noise=0.02) as node:
        for index in range(20):
            port.write(imu_frame(protocol, index))
            node.until(lambda: len(node.received['imu/data']) == index + 1)  # noqa: B023
        assert node.health().values['frames_ok'] == '20'
        port.write(bytes(500))
        node.until(lambda: node._source.bytes_skipped == 500)
        assert '500 bytes skipped' in node.health().message
        assert 'skipped' not in node.health().message
        source = 'arrival' if protocol == 'vectornav_ascii' else 'device clock'
        assert source in node.health().values['stamps']
    for message in node.received['imu/data']:
        force = message.linear_acceleration
        assert (force.x, force.y, force.z) == pytest.approx((0.5, -0.25, 9.8125), abs=1e-3)
        assert message.header.frame_id == 'imu_link'
        assert list(message.angular_velocity_covariance) == pytest.approx(
            np.ravel(0.02 ** 2 * np.eye(3)))
        assert list(message.linear_acceleration_covariance) == pytest.approx(
            np.ravel(0.05 ** 2 * np.eye(3)))
        assert (message.orientation_covariance[0] == -1.0) == (protocol != 'vectornav_ascii')
    stamps = [sample.stamp_ns for sample in node.samples('imu/data')]
    assert np.all(np.diff(stamps) > 0)


def test_the_driver_recovers_from_a_missing_busy_or_unplugged_port(isolated_ros, port):
    def send():
        port.write(imu_frame('vectornav_binary', 0))

    def until_data():
        node.received['imu/data'].clear()
        node.until(lambda: node.received['imu/data'], send)

    with local(ImuDriver, port=port.path) as node:
        node.until(lambda: 'there is no such port' in node.health().message)
        assert node.health().level == DiagnosticStatus.ERROR
        port.plug_in()
        other = open_port(str(port.path), 115200)
        node.until(lambda: 'it is busy' in node.health().message)
        other.close()
        until_data()
        node.until(lambda: node.health().message == 'ok', send)
        port.unplug()
        node.until(lambda: node.health().level == DiagnosticStatus.ERROR)
        port.plug_in()
        until_data()
        assert node.health().values['port_opened'] == '2'
        assert f'lost {port.path}: ' in str(node.log.lines)


@pytest.mark.parametrize(('node_class', 'topic', 'frame', 'parameters'), [
    (ImuDriver, 'imu/data', lambda number: imu_frame('vectornav_binary', number), {}),
    (TireReceiver, 'tire_samples', lambda number: packet(number, 0x0013A20040A1B2C2),
     {'units': '["0013A20040A1B2C2=front_left"]'})])
def test_the_data_of_a_link_return_after_a_loss_a_stall_and_a_reset(
        node_class, topic, frame, parameters, isolated_ros, port):
    numbers = count()

    def send():
        port.write(frame(next(numbers)))

    def until_data():
        node.received[topic].clear()
        node.until(lambda: node.received[topic], send)

    with receiving(node_class, port, **parameters) as node:
        until_data()
        port.unplug()
        node.until(lambda: node.health().message.startswith('cannot open'))
        port.plug_in()
        until_data()
        node.until(lambda: node.health().message == 'ok', send)
        node.until(lambda: node.health().message != 'ok')  # it stalls
        until_data()
        port.write(frame(next(numbers))[:20] + bytes(range(256)))  # it resets
        until_data()


def failure():
    """Return an error of ROS that fails to publish."""
    return RCLError('Failed to publish: no memory, at /project/src/rcl/publisher.c:246')


@pytest.mark.parametrize('topic', ['imu/data', '/diagnostics'])
def test_the_imu_driver_continues_after_messages_that_ros_fails_to_publish(
        topic, isolated_ros, port):
    numbers = count()
    with receiving(ImuDriver, port) as node:
        node.failures[topic] = [failure() for _ in range(5)]
        node.until(lambda: len(node.received['imu/data']) >= 20 and not node.failures[topic],
                   lambda: port.write(imu_frame('vectornav_binary', next(numbers))))
        assert node.health().values['publish_errors'] == '5'
    logged = [line for line in node.log.lines if 'not published' in line]
    assert [line.partition(': ')[2].split()[0] for line in logged] == ['1', '2', '4']
    assert all('no memory' in line and '/project' not in line for line in logged)


def test_messages_that_ros_fails_to_publish_are_an_error_in_the_diagnostics(isolated_ros, port):
    with receiving(TireReceiver, port) as node:
        node.failures['tire_samples'] = [failure() for _ in range(5)]
        port.write(packet(0, 0x0013A20040A1B2C3))
        node.until(lambda: len(node.received['tire_samples']) == 11)
        health = node.health()
        assert '5 messages on tire_samples not published' in health.message
        assert health.level == DiagnosticStatus.ERROR
        health = node.health()
        assert 'not published' not in health.message
        assert health.values['publish_errors'] == '5'


def test_an_open_port_without_valid_frames_is_an_error(isolated_ros, port):
    with receiving(TireReceiver, port) as node:
        assert 'no valid frames are received' in node.health().message


def test_frames_of_another_protocol_are_named(isolated_ros, port):
    with receiving(ImuDriver, port, protocol='xsens') as node:
        port.write(b''.join(imu_frame('vectornav_ascii', index) for index in range(5)))
        node.until(lambda: 'but those of VectorNav (ASCII): set protocol' in node.health().message)
        port.write(b''.join(imu_frame('xsens', index) for index in range(3)))
        node.until(lambda: 'no valid frames' not in node.health().message)


@pytest.fixture(scope='module')
def robot(tmp_path_factory, isolated_ros):
    """Return emulated boards and a motor driver that the tests share."""
    with RobotRig(tmp_path_factory.mktemp('rig'), controller=False, rate=50.0) as made:
        yield made
        assert made.processes['motor_driver'].end() == 0


def test_the_motors_follow_commands_and_their_state_is_published(robot):
    graph, driver = robot.graph, robot.processes['motor_driver']
    graph.until(lambda: graph.value('motor_driver', 'supply') == '14.8')
    graph.until(lambda: np.allclose(graph.samples('wheel_states', 1)[-1].velocity,
                                    (10.0, 6.0, -8.0, 0.0), atol=1.0),
                lambda: graph.publish('motor_commands', MotorCommand(
                    time.time_ns(), (0.5, 0.3, -0.4, 0.0))))
    sample = graph.samples('wheel_states')[-1]
    assert sample.effort is not None and max(map(abs, sample.effort)) < 3.0  # N m
    assert sample.effort[0] > 0.0 > sample.effort[2]
    graph.until(lambda: robot.rig.state().still)
    short = JointState(name=['front_left'], effort=[1.0])
    graph.publish_message('motor_commands', short)
    graph.until(lambda: graph.value('motor_driver', 'motor_commands.rejected') == '1')
    graph.until(lambda: graph.value('motor_driver', 'command_timeouts') not in ('', '0'))
    assert graph.value('motor_driver', 'emergency_stop') == 'False'
    assert graph.value('motor_driver', 'armed') == 'True'
    graph.until(lambda: float(graph.value('motor_driver', 'line_rate_limit') or 0.0) > 1.0)
    assert driver.output.count('motor_driver]: 2 boards on the line: one poll takes ') == 1
    assert 'motors stopped: no motor command for 0.25 s' in driver.output


@pytest.mark.parametrize('node_class, explained', [
    (MotorDriver, ['2 bad frames, latest: no reply', '3 bytes skipped']), (TireReceiver, [])])
def test_a_late_host_explains_bad_replies_but_no_damaged_frames(node_class, explained):
    source = SimpleNamespace(frames_bad=2, bytes_skipped=3, last_error='no reply')
    node = SimpleNamespace(_source=source, _next_logged=4, polls=node_class.polls)
    status = Status()
    node_class._fill_bad_frames(node, status)
    assert (len(status.warnings), status.explained) == (2, explained)


def test_a_silent_board_is_named_in_an_error_and_disables_the_motors(robot):
    graph, enabled = robot.graph, []
    graph.node.create_subscription(
        Bool, 'motors_enabled', lambda message: enabled.append(message.data), latched())
    graph.until(lambda: enabled and enabled[-1])
    faults = int(graph.value('motor_driver', 'board_faults'))
    robot.rig.fail(mute={129})
    graph.until(lambda: 'wheel_states stopped: rear board 129 (0x81) does not respond'
                in graph.status_message('motor_driver'))
    assert graph.health['motor_driver'].level == DiagnosticStatus.ERROR
    assert int(graph.value('motor_driver', 'board_faults')) > faults
    graph.until(lambda: not enabled[-1])
    robot.rig.fail()
    graph.until(lambda: graph.status_message('motor_driver') == 'ok' and enabled[-1])
    graph.received['wheel_states'].clear()
    graph.until(lambda: graph.received['wheel_states'])


def test_missing_currents_are_reported_and_leave_the_rest(robot):
    graph = robot.graph
    robot.rig.fail(without_currents={129}, currents={0: 5000})
    graph.until(lambda: 'no motor torques: rear board 129 (0x81) does not report currents'
                in graph.status_message('motor_driver'))
    graph.until(lambda: 'motor currents beyond 30 A rejected'
                in graph.status_message('motor_driver'))
    graph.until(lambda: graph.samples('wheel_states', 1)[-1].effort is not None and np.isnan(
        graph.samples('wheel_states', 1)[-1].effort).tolist() == [True, False, True, True])
    robot.rig.fail()
    graph.until(lambda: graph.status_message('motor_driver') == 'ok')
