# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The radio tap forwards every byte and identifies batches by their samples."""

import math
import os
import select
import subprocess
import sys
import tty
from types import SimpleNamespace

from benchmarks.empty_node import exchange
from benchmarks.load import (
    Delays, draw, MAX_SPEED, path_for, print_host, RadioTap, RADIUS, RANGES, SETUPS, Usage,
    usage_table)
import numpy as np
import pytest
from smart_tire.cli._path_file import length
from smart_tire.cli._stack import NODES
from smart_tire.errors import SmartTireError
from smart_tire.host_load import HostLoad
from smart_tire.protocol.tire_payload import encode_batch, TireBatch, volts
from smart_tire.protocol.xbee import encode_frame, encode_receive_packet, ReceivePacket
from smart_tire.samples import TireSample
from smart_tire.simulation.pseudo_terminal import PtyPort
from support.waiting import PATIENCE

pytestmark = pytest.mark.processes


def batch(number):
    codes = tuple((500 + 16 * number + i, 520 + i) for i in range(16))
    return TireBatch(0, number, 40_000 * number, 2500, codes, 3700)


def frame(number):
    packet = ReceivePacket(7, 0xFFFE, 1, encode_batch(batch(number)))
    return encode_frame(encode_receive_packet(packet))


def samples(number, wheel='front_right'):
    return [TireSample(number, wheel, tuple(map(volts, codes)))
            for codes in batch(number).codes]


def read(descriptor, size):
    """Return ``size`` bytes."""
    data = b''
    while len(data) < size and select.select([descriptor], [], [], PATIENCE)[0]:
        data += os.read(descriptor, size - len(data))
    return data


@pytest.fixture
def line(tmp_path):
    """Return the port of a radio, the tap, and the open port of a receiver."""
    with PtyPort(str(tmp_path / 'radio')) as radio, RadioTap(
            radio.link, str(tmp_path / 'tapped')) as tap:
        descriptor = os.open(tmp_path / 'tapped', os.O_RDWR | os.O_NOCTTY)
        tty.setraw(descriptor)
        while not select.select([descriptor], [], [], 0.02)[0]:
            radio.write(b'?')  # lost until the tap has opened the port
        radio.write(b'!')
        while read(descriptor, 1) == b'?':
            pass
        yield radio, tap, descriptor
        os.close(descriptor)


def test_all_bytes_are_forwarded_and_each_complete_batch_has_a_latency(line):
    radio, tap, descriptor = line
    for number in range(3):
        whole = frame(number)
        for part in whole[:20], whole[20:]:
            for sample in samples(number):
                tap.add_sample(sample)  # of a batch that is not complete
            assert len(tap.latencies) == number
            radio.write(part)
            assert read(descriptor, len(part)) == part
        for sample in samples(number):
            tap.add_sample(sample)
    assert len(tap.latencies) == 3 and min(tap.latencies) > 0.0


def test_batches_of_several_wheels_have_latencies_although_their_samples_alternate(line):
    radio, tap, descriptor = line
    for number in (7, 8):
        radio.write(frame(number))
        read(descriptor, len(frame(number)))
    for pair in zip(samples(7, 'front_left'), samples(8, 'rear_left')):
        for sample in pair:
            tap.add_sample(sample)
    assert len(tap.latencies) == 2


def test_the_path_lasts_for_the_measurement_and_begins_at_the_robot():
    odometry = SimpleNamespace(position=(1.0, 2.0, 0.0), orientation=(0.0, 0.0, 1.0, 0.0))
    for seconds in (1.0, 60.0, 600.0):
        path = path_for(seconds, odometry)
        assert path[0][:2] == pytest.approx((1.0, 2.0))
        assert path[1][0] < 1.0  # it has turned round
        assert seconds * MAX_SPEED <= length(path) < seconds * MAX_SPEED + 16.0 * RADIUS
        assert max(map(math.dist, (one[:2] for one in path), (one[:2] for one in path[1:]))) < 0.1


def test_the_table_has_each_process_and_the_sum_of_a_robot():
    simulator, few, many = Usage(0.5, 9e6), Usage(0.1, 40e6, 0.05), Usage(0.25, 41e6, 0.1)
    table = usage_table({'few': {'robot_simulator': simulator, 'a': few, 'b': few},
                         'many': {'robot_simulator': simulator, 'a': many, 'b': few}})
    assert list(zip(*(column.cells for column in table.columns))) == [
        ('robot_simulator', '0.500', '9', '', '0.500', '9', ''),
        ('a', '0.100', '40', '2.0', '0.250', '41', '2.5'),
        ('b', '0.100', '40', '2.0', '0.100', '40', '2.0'),
        ('all but robot_simulator', '0.200', '80', '2.0', '0.350', '81', '2.3')]


MS = 1_000_000  # ns


def test_an_odom_is_late_against_those_of_its_phase(tmp_path):
    ages = [(8 * MS * step, 0.030 + 0.001 * (step % 5)) for step in range(100)]
    ages[50] = ages[50][0], ages[50][1] + 0.020
    found = Delays.of([0.010, 0.020, 0.030], ages)
    late = np.zeros(100)
    late[50] = 0.020
    assert found.excess == pytest.approx(late, abs=1e-9)
    assert found.figures == pytest.approx((
        29.8, 32.0, 1e3 * np.percentile(late, 99.0)), abs=1e-6)
    assert [line.split(': ')[1] for line in found.lines()] == [
        'p50 20.0 ms, p99 29.8 ms, worst 30.0 ms', 'p50 32.0 ms; later than usual by p99 0.2 ms, '
        'p99.9 18.0 ms, worst 20.0 ms']
    draw({'a robot': found}, tmp_path / 'delays.png')
    assert (tmp_path / 'delays.png').stat().st_size > 10_000


def test_delays_without_messages_are_an_error():
    for latencies, ages in ([], [(0, 0.03)]), ([0.01], []):
        with pytest.raises(SmartTireError, match='no radio batch'):
            Delays.of(latencies, ages)


def test_the_floor_publishes_the_bytes_in_bursts_and_one_timer_serves_a_rate():
    sent, received, timers = [], [], {}

    def publisher(cls, topic, depth):
        return SimpleNamespace(publish=lambda data: sent.append((cls.__name__, topic, data)))

    exchange(SimpleNamespace(
        create_publisher=publisher, create_timer=timers.__setitem__,
        create_subscription=lambda cls, topic, callback, depth, raw: received.append(
            (cls.__name__, topic, depth, raw))), {
        'received': [['/imu/data', 'sensor_msgs/msg/Imu', 7]],
        'published': [['/odom', 'nav_msgs/msg/Odometry', 3, 125, 1, '00ff'],
                      ['/wheel_slip', 'sensor_msgs/msg/JointState', 3, 125, 1, '01'],
                      ['/tire_samples', 'sensor_msgs/msg/JointState', 3, 10, 4, '02']]})
    assert received == [('Imu', '/imu/data', 7, True)]
    assert not sent
    timers.pop(1.0 / 125)()
    assert sent == [('Odometry', '/odom', b'\x00\xff'), ('JointState', '/wheel_slip', b'\x01')]
    timers.pop(0.1)()
    assert sent[2:] == 4 * [('JointState', '/tire_samples', b'\x02')]
    assert not timers


def test_a_busy_machine_is_named(capsys):
    for lateness in (0.001, 0.031):
        print_host(HostLoad(lateness, 0.1, 9.0, 2))
    assert capsys.readouterr().out == (
        '  not a quiet machine: timers late by 31 ms (99%), load 9.0 on 2 cores: end other '
        'programs\n')


@pytest.mark.long  # two runs of the whole stack
def test_the_stack_follows_the_path_while_it_is_measured(tmp_path):
    done = subprocess.run([sys.executable, '-m', 'benchmarks.load', '--seconds', '3', '--out',
                           str(tmp_path)], check=False, capture_output=True, text=True)
    out = done.stdout
    assert done.returncode == (1 if 'OUTSIDE' in out else 0), done.stderr  # of a busy machine
    assert all(one.figure in out for one in RANGES)
    assert out.count('age of odom on arrival') == len(SETUPS) == 2
    rows = {line.split()[0]: line.split()[1:] for line in out.splitlines()
            if line.split() and line.split()[0] in NODES}
    assert list(rows) == list(NODES)
    assert all(float(cell) > 0.0 for cells in rows.values() for cell in cells)
    assert {name: len(cells) for name, cells in rows.items()} == {
        name: 4 if name == 'robot_simulator' else 6 for name in NODES}  # with floors
