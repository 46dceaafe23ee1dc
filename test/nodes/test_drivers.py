# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Driver nodes as processes: from bytes on a port to messages."""

from __future__ import annotations

from dataclasses import replace
from itertools import count
import time

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from smart_tire.drivers.serial_port import open_port
from smart_tire.nodes.qos import latched
from smart_tire.protocol import vectornav, vectornav_ascii, xsens
from smart_tire.protocol.tire_payload import encode_batch, TireBatch
from smart_tire.protocol.xbee import encode_frame, encode_receive_packet, ReceivePacket
from smart_tire.samples import ImuSample, MotorCommand
from std_msgs.msg import Bool
from support.graph import Process
from support.robot_rig import RobotRig

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


def test_a_batch_is_published_as_one_message_per_conversion(graph, port):
    port.plug_in()
    graph.subscribe('tire_samples', 'tire_battery')
    with graph.start('tire_receiver', port=port.path, units=UNITS_TEXT) as node:
        graph.until(lambda: graph.value('tire_receiver', 'port_opened') == '1'
                    and graph.has_publishers())
        before = time.time_ns()
        lost, unknown_address = {5, 6}, 0x0013A200DEADBEEF
        for number in range(10):
            port.write(b''.join(packet(number, address) for address in UNITS
                                if number not in lost or address != 0x0013A20040A1B2C2))
            graph.spin()
        port.write(packet(9, 0x0013A20040A1B2C3) + packet(0, unknown_address)
                   + packet(0, 0x0013A20040A1B2C3, b'\x02' + bytes(80)))
        graph.until(lambda: len(graph.received['tire_samples']) == (10 + 8) * 16
                    and len(graph.received['tire_battery']) == 2
                    and graph.value('tire_receiver', 'frames_bad') == '2')
        graph.until(lambda: 'no batches from front_left; no batches from front_right'
                    in graph.status_message('tire_receiver'))
        counts = {key: graph.value('tire_receiver', key) for key in (
            'frames_ok', 'batches_ok', 'batches_lost', 'batches_duplicate',
            'front_left.batches_lost', 'front_right.batches_lost')}
        assert counts == {'frames_ok': '19', 'batches_ok': '18', 'batches_lost': '2',
                          'batches_duplicate': '1', 'front_left.batches_lost': '2',
                          'front_right.batches_lost': '0'}
        assert node.end() == 0
        assert 'bad frames, latest: ' in node.output
    for wheel in UNITS.values():
        samples = [sample for sample in graph.samples('tire_samples') if sample.wheel == wheel]
        stamps = [sample.stamp_ns for sample in samples[:16]]
        assert np.diff(stamps) == pytest.approx(2_500_000)
        assert before - 100_000_000 < stamps[0] < stamps[-1] < time.time_ns()
        assert samples[15].volts == pytest.approx((3.3, 511 * 3.3 / 1023))
    (names,) = {tuple(message.name) for message in graph.received['tire_samples']
                if message.header.frame_id == 'front_right'}
    assert names == ('front_right_pvdf_1', 'front_right_pvdf_2')


@pytest.mark.parametrize('protocol', ['vectornav_binary', 'vectornav_ascii', 'xsens'])
def test_imu_samples_are_in_rep_103_axes_for_every_protocol(protocol, graph, port):
    port.plug_in()
    graph.subscribe('imu/data')
    with graph.start('imu_driver', port=port.path, protocol=protocol) as node:
        graph.until(lambda: graph.value('imu_driver', 'port_opened') == '1'
                    and graph.has_publishers())
        for index in range(20):
            port.write(imu_frame(protocol, index))
            graph.spin()
        graph.until(lambda: len(graph.received['imu/data']) == 20
                    and graph.value('imu_driver', 'frames_ok') == '20')
        port.write(bytes(500))
        graph.until(lambda: '500 bytes skipped' in graph.status_message('imu_driver'))
        assert graph.value('imu_driver', 'bytes_skipped') == '500'
        graph.until(lambda: 'skipped' not in graph.status_message('imu_driver'))
        source = 'arrival' if protocol == 'vectornav_ascii' else 'device clock'
        assert source in graph.value('imu_driver', 'stamps')
        assert node.end() == 0
    for message in graph.received['imu/data']:
        force = message.linear_acceleration
        assert (force.x, force.y, force.z) == pytest.approx((0.5, -0.25, 9.8125), abs=1e-3)
        assert message.header.frame_id == 'imu_link'
        assert (message.orientation_covariance[0] == -1.0) == (protocol != 'vectornav_ascii')
    stamps = [sample.stamp_ns for sample in graph.samples('imu/data')]
    assert np.all(np.diff(stamps) > 0)


def test_the_driver_recovers_from_a_missing_busy_or_unplugged_port(graph, port):
    graph.subscribe('imu/data')

    def send():
        port.write(imu_frame('vectornav_binary', 0))

    with graph.start('imu_driver', port=port.path) as node:
        graph.until(lambda: 'there is no such port' in graph.status_message('imu_driver'))
        assert graph.health['imu_driver'].level == DiagnosticStatus.ERROR
        port.plug_in()
        other = open_port(str(port.path), 115200)
        graph.until(lambda: 'it is busy' in graph.status_message('imu_driver'))
        other.close()
        graph.until(lambda: graph.received['imu/data'], send)
        graph.until(lambda: graph.status_message('imu_driver') == 'ok')
        port.unplug()
        graph.until(lambda: graph.health['imu_driver'].level == DiagnosticStatus.ERROR)
        graph.received['imu/data'].clear()
        port.plug_in()
        graph.until(lambda: graph.received['imu/data'], send)
        graph.until(lambda: graph.value('imu_driver', 'port_opened') == '2')
        assert node.end() == 0
        assert f'lost {port.path}: ' in node.output
        assert 'Traceback' not in node.output


@pytest.mark.parametrize(('name', 'topic', 'frame', 'parameters'), [
    ('imu_driver', 'imu/data', lambda number: imu_frame('vectornav_binary', number), {}),
    ('tire_receiver', 'tire_samples', lambda number: packet(number, 0x0013A20040A1B2C2),
     {'units': '["0013A20040A1B2C2=front_left"]'})])
def test_the_data_of_a_link_return_within_two_seconds(name, topic, frame, parameters, graph, port):
    numbers, received = count(), graph.received[topic]

    def send():
        port.write(frame(next(numbers)))

    def until_data():
        received.clear()
        begin = time.monotonic()
        graph.until(lambda: received, send)
        return time.monotonic() - begin

    graph.subscribe(topic)
    port.plug_in()
    with graph.start(name, port=port.path, **parameters) as node:
        until_data()
        port.unplug()
        graph.until(lambda: graph.status_message(name).startswith('cannot open'))
        port.plug_in()
        assert until_data() < 2.0  # s
        graph.until(lambda: graph.status_message(name) == 'ok', send)
        graph.until(lambda: graph.status_message(name) != 'ok')  # it stalls
        assert until_data() < 2.0
        port.write(frame(next(numbers))[:20] + bytes(range(256)))  # it resets
        assert until_data() < 2.0
        assert node.end() == 0


FAILING_PUBLISHER = """
import sys

from rclpy.publisher import Publisher
from smart_tire.nodes.compat import RCLError

publish, failures = Publisher.publish, []


def fail_five_times(self, message):
    if self.topic_name == '/{topic}' and len(failures) < 5:
        failures.append(message)
        raise RCLError('Failed to publish: no memory, at /project/src/rcl/publisher.c:246')
    publish(self, message)


Publisher.publish = fail_five_times
from smart_tire.nodes import {node}

sys.exit({node}.main())
"""


@pytest.mark.parametrize('topic', ['imu/data', 'diagnostics'])
def test_the_imu_driver_continues_after_messages_that_ros_fails_to_publish(
        topic, graph, port, tmp_path):
    port.plug_in()
    graph.subscribe('imu/data')
    script = FAILING_PUBLISHER.format(topic=topic, node='imu_driver')
    with Process(['-c', script, '--ros-args', '-p', f'port:={port.path}'],
                 tmp_path / 'log') as node:
        numbers = count()
        graph.until(lambda: len(graph.received['imu/data']) >= 20
                    and graph.value('imu_driver', 'publish_errors') == '5',
                    lambda: port.write(imu_frame('vectornav_binary', next(numbers))))
        assert node.end() == 0
        logged = [line for line in node.output.splitlines() if 'not published' in line]
        assert [line.partition(': ')[2].split()[0] for line in logged] == ['1', '2', '4']
        assert all('no memory' in line and '/project' not in line for line in logged)
        assert 'Traceback' not in node.output


def test_messages_that_ros_fails_to_publish_are_an_error_in_the_diagnostics(
        graph, port, tmp_path):
    port.plug_in()
    graph.subscribe('tire_samples')
    script = FAILING_PUBLISHER.format(topic='tire_samples', node='tire_receiver')
    with Process(['-c', script, '--ros-args', '-p', f'port:={port.path}'],
                 tmp_path / 'log') as node:
        graph.until(lambda: graph.value('tire_receiver', 'port_opened') == '1'
                    and graph.has_publishers())
        port.write(packet(0, 0x0013A20040A1B2C3))
        graph.until(lambda: '5 messages on tire_samples not published'
                    in graph.status_message('tire_receiver'))
        assert graph.health['tire_receiver'].level == DiagnosticStatus.ERROR
        graph.until(lambda: len(graph.received['tire_samples']) == 11)
        graph.until(lambda: 'not published' not in graph.status_message('tire_receiver'))
        assert graph.value('tire_receiver', 'publish_errors') == '5'
        assert node.end() == 0


def test_an_open_port_without_valid_frames_is_an_error(graph, port):
    port.plug_in()
    with graph.start('tire_receiver', port=port.path) as node:
        graph.until(lambda: 'no valid frames are received'
                    in graph.status_message('tire_receiver'))
        assert node.end() == 0


def test_the_motors_follow_commands_and_their_state_is_published(tmp_path, isolated_ros):
    with RobotRig(tmp_path, controller=False, rate=50.0) as robot:
        graph = robot.graph
        graph.until(lambda: graph.value('motor_driver', 'supply') == '14.8')
        graph.until(lambda: np.allclose(graph.samples('wheel_states')[-1].velocity,
                                        (10.0, 6.0, -8.0, 0.0), atol=1.0),
                    lambda: graph.publish('motor_commands', MotorCommand(
                        time.time_ns(), (0.5, 0.3, -0.4, 0.0))))
        sample = graph.samples('wheel_states')[-1]
        assert sample.effort is not None and max(map(abs, sample.effort)) < 3.0  # N m
        assert sample.effort[0] > 0.0 > sample.effort[2]
        assert graph.value('motor_driver', 'currents_rejected') == '0'
        graph.until(lambda: robot.rig.state().still)
        short = JointState(name=['front_left'], effort=[1.0])
        graph.publish_message('motor_commands', short)
        graph.until(lambda: graph.value('motor_driver', 'motor_commands.rejected') == '1')
        graph.until(lambda: graph.value('motor_driver', 'command_timeouts') == '1')
        assert graph.value('motor_driver', 'emergency_stop') == 'False'
        assert graph.value('motor_driver', 'armed') == 'True'
        assert graph.value('motor_driver', 'board_faults') == '0'
        graph.until(lambda: float(graph.value('motor_driver', 'line_rate_limit') or 0.0) > 1.0)
        assert robot.processes['motor_driver'].output.count(
            'motor_driver]: 2 boards on the line: one poll takes ') == 1
        assert robot.processes['motor_driver'].end() == 0
        assert robot.processes['motor_driver'].output.count(
            'motors stopped: no motor command for 0.25 s') == 1


def test_a_silent_board_is_named_in_an_error_and_disables_the_motors(tmp_path, isolated_ros):
    with RobotRig(tmp_path, controller=False) as robot:
        graph, enabled = robot.graph, []
        graph.node.create_subscription(
            Bool, 'motors_enabled', lambda message: enabled.append(message.data), latched())
        graph.until(lambda: enabled and enabled[-1])
        robot.rig.fail(mute={129})
        graph.until(lambda: 'wheel_states stopped: rear board 129 (0x81) does not respond'
                    in graph.status_message('motor_driver'))
        assert graph.health['motor_driver'].level == DiagnosticStatus.ERROR
        assert graph.value('motor_driver', 'board_faults') == '1'
        graph.until(lambda: not enabled[-1])
        count_before = len(graph.received['wheel_states'])
        robot.rig.fail()
        graph.until(lambda: graph.status_message('motor_driver') == 'ok' and enabled[-1])
        assert len(graph.received['wheel_states']) > count_before
        assert robot.processes['motor_driver'].end() == 0


def test_missing_currents_are_reported_and_leave_the_rest(tmp_path, isolated_ros):
    with RobotRig(tmp_path, controller=False) as robot:
        graph = robot.graph
        robot.rig.fail(without_currents={129}, currents={0: 5000})
        graph.until(lambda: 'no motor torques: rear board 129 (0x81) does not report currents'
                    in graph.status_message('motor_driver'))
        graph.until(lambda: 'motor currents beyond 30 A rejected'
                    in graph.status_message('motor_driver'))
        graph.until(lambda: graph.samples('wheel_states')[-1].effort is not None)
        effort = graph.samples('wheel_states')[-1].effort
        assert np.isnan(effort).tolist() == [True, False, True, True]
        assert graph.value('motor_driver', 'board_faults') == '0'
        robot.rig.fail()
        graph.until(lambda: graph.status_message('motor_driver') == 'ok')
        assert robot.processes['motor_driver'].end() == 0
