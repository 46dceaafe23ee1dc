"""The drivers as processes: bytes on a port in, messages on DDS out."""

from __future__ import annotations

from dataclasses import replace
import math
import time

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from support.boards import Boards

from smart_tire.links.serial_link import open_port
from smart_tire.protocol import vectornav, vectornav_ascii, xsens
from smart_tire.protocol.roboclaw import DUTY_MAX
from smart_tire.protocol.tire_payload import encode_batch, TireBatch
from smart_tire.protocol.xbee import encode_frame, encode_receive_packet, ReceivePacket
from smart_tire.samples import ImuSample, MotorCommand

UNITS = {0x0013A20040A1B2C2: 'front_left', 0x0013A20040A1B2C3: 'front_right'}
UNITS_TEXT = '[' + ', '.join(f'"{address:016X}={wheel}"' for address, wheel in UNITS.items()) + ']'
BATCH = TireBatch(flags=0, sequence=0, timer_us=0, period_us=2500,
                  codes=((0, 512),) * 15 + ((1023, 511),), battery_mv=3700)
IMU = ImuSample(0, (0.5, -0.25, 9.8125), (0.125, 0.0, -0.5))


def packet(count, address, payload=b''):
    """Return the bytes of a unit's batch ``count``, or of another payload."""
    batch = replace(BATCH, sequence=count, timer_us=40_000 * count)
    return encode_frame(encode_receive_packet(
        ReceivePacket(address, 0xFFFE, 1, payload or encode_batch(batch))))


def imu_frame(protocol, index):
    """Return the bytes of a sample at 100 Hz."""
    if protocol == 'vectornav_binary':
        return vectornav.encode_frame(vectornav.encode_binary(index * 10_000_000, IMU))
    if protocol == 'xsens':
        return xsens.encode_message(xsens.encode_imu(index * 10_000_000, IMU))
    return vectornav_ascii.encode_sentence(vectornav_ascii.encode_ymr(IMU))


def test_a_batch_becomes_a_message_for_every_conversion(graph, port):
    port.plug_in()
    graph.listen('tire_samples', 'tire_battery')
    with graph.start('tire_receiver', port=port.path, units=UNITS_TEXT) as node:
        graph.until(lambda: graph.value('tire_receiver', 'port_opened') == '1'
                    and graph.is_fed())
        before = time.time_ns()
        lost, stranger = {5, 6}, 0x0013A200DEADBEEF
        for count in range(10):
            port.write(b''.join(packet(count, address) for address in UNITS
                                if count not in lost or address != 0x0013A20040A1B2C2))
            graph.turn()
        port.write(packet(9, 0x0013A20040A1B2C3) + packet(0, stranger)
                   + packet(0, 0x0013A20040A1B2C3, b'\x02' + bytes(80)))
        graph.until(lambda: len(graph.heard['tire_samples']) == (10 + 8) * 16
                    and len(graph.heard['tire_battery']) == 2
                    and graph.value('tire_receiver', 'frames_bad') == '2')
        graph.until(lambda: 'nothing from front_left; nothing from front_right'
                    in graph.complaint('tire_receiver'))
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
    (names,) = {tuple(message.name) for message in graph.heard['tire_samples']
                if message.header.frame_id == 'front_right'}
    assert names == ('front_right_pvdf_1', 'front_right_pvdf_2')


@pytest.mark.parametrize('protocol', ['vectornav_binary', 'vectornav_ascii', 'xsens'])
def test_the_imu_speaks_in_our_axes_whatever_its_protocol(protocol, graph, port):
    port.plug_in()
    graph.listen('imu/data')
    with graph.start('imu_driver', port=port.path, protocol=protocol) as node:
        graph.until(lambda: graph.value('imu_driver', 'port_opened') == '1'
                    and graph.is_fed())
        for index in range(20):
            port.write(imu_frame(protocol, index))
            graph.turn()
        graph.until(lambda: len(graph.heard['imu/data']) == 20
                    and graph.value('imu_driver', 'frames_ok') == '20')
        port.write(bytes(500))
        graph.until(lambda: '500 bytes skipped' in graph.complaint('imu_driver'))
        assert graph.value('imu_driver', 'bytes_skipped') == '500'
        graph.until(lambda: 'skipped' not in graph.complaint('imu_driver'))
        source = 'arrival' if protocol == 'vectornav_ascii' else 'device clock'
        assert source in graph.value('imu_driver', 'stamps')
        assert node.end() == 0
    for message in graph.heard['imu/data']:
        force = message.linear_acceleration
        assert (force.x, force.y, force.z) == pytest.approx((0.5, -0.25, 9.8125), abs=1e-3)
        assert message.header.frame_id == 'imu_link'
        assert (message.orientation_covariance[0] == -1.0) == (protocol != 'vectornav_ascii')
    stamps = [sample.stamp_ns for sample in graph.samples('imu/data')]
    assert np.all(np.diff(stamps) > 0)


def test_a_port_may_be_missing_busy_unplugged_and_plugged_in_again(graph, port):
    graph.listen('imu/data')

    def send():
        port.write(imu_frame('vectornav_binary', 0))

    with graph.start('imu_driver', port=port.path) as node:
        graph.until(lambda: 'there is no such port' in graph.complaint('imu_driver'))
        assert graph.health['imu_driver'].level == DiagnosticStatus.ERROR
        port.plug_in()
        other = open_port(str(port.path), 115200)
        graph.until(lambda: 'it is busy' in graph.complaint('imu_driver'))
        other.close()
        graph.until(lambda: graph.heard['imu/data'], send)
        graph.until(lambda: graph.complaint('imu_driver') == 'ok')
        port.unplug()
        graph.until(lambda: graph.health['imu_driver'].level == DiagnosticStatus.ERROR)
        graph.heard['imu/data'].clear()
        port.plug_in()
        graph.until(lambda: graph.heard['imu/data'], send)
        graph.until(lambda: graph.value('imu_driver', 'port_opened') == '2')
        assert node.end() == 0
        assert f'lost {port.path}: ' in node.output
        assert 'Traceback' not in node.output


def test_a_port_on_which_nothing_comes_is_an_error(graph, port):
    port.plug_in()
    with graph.start('tire_receiver', port=port.path) as node:
        graph.until(lambda: 'nothing intelligible' in graph.complaint('tire_receiver'))
        assert node.end() == 0


def test_the_motors_follow_commands_and_stop_without_them(graph, port):
    with Boards(port.plug_in()) as boards:
        graph.listen('wheel_states')
        with graph.start('motor_driver', port=port.path, rate=50.0,
                         command_timeout=1.0) as node:
            graph.until(lambda: graph.heard['wheel_states'])
            start = graph.samples('wheel_states')[0].position
            boards.counts = {128: (20, 40), 129: (60, 2**32 - 80)}
            graph.say('motor_commands', MotorCommand(1, (0.5, 1.0, -1.0, 0.0)))
            graph.until(lambda: boards.duty == {128: (round(DUTY_MAX / 2), DUTY_MAX),
                                                129: (-DUTY_MAX, 0)})
            graph.until(lambda: graph.samples('wheel_states')[-1].effort
                        == pytest.approx((0.5, 1.0, -1.0, 0.0), abs=1e-4))
            graph.until(lambda: boards.duty == {128: (0, 0), 129: (0, 0)})
            end = graph.samples('wheel_states')[-1].position
            turned = [(b - a) * 2000 / math.tau for a, b in zip(start, end)]
            assert turned == pytest.approx([20, 40, 60, -80], abs=1e-6)
            bad = JointState(name=['front_left', 'front_right', 'rear_left', 'rear_right'],
                             effort=[1.0, math.nan, 1.0, 1.0])
            graph.say_message('motor_commands', bad)
            graph.until(lambda: '1 bad on motor_commands' in graph.complaint('motor_driver'))
            short = JointState(name=['front_left'], effort=[1.0])
            graph.say_message('motor_commands', short)
            graph.until(lambda: graph.value('motor_driver', 'motor_commands.rejected') == '2')
            assert boards.duty == {128: (0, 0), 129: (0, 0)}
            assert node.end() == 0
            assert 'motors stopped' in node.output
            assert 'effort is [1.0, nan' in node.output
    assert boards.timeout == {128: 10, 129: 10}


def test_a_silent_board_is_an_error_with_its_name(graph, port):
    with Boards(port.plug_in()) as boards:
        boards.answering = {128}
        graph.listen('wheel_states')
        with graph.start('motor_driver', port=port.path) as node:
            graph.until(lambda: 'no wheel_states, for the rear board 129 (0x81) does not answer'
                        in graph.complaint('motor_driver'))
            assert graph.health['motor_driver'].level == DiagnosticStatus.ERROR
            assert 'front board' not in graph.complaint('motor_driver')
            assert not graph.heard['wheel_states']
            boards.answering = {128, 129}
            graph.until(lambda: graph.complaint('motor_driver') == 'ok')
            assert graph.heard['wheel_states']
            assert node.end() == 0
