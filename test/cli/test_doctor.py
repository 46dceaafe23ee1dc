# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Doctor of a bag and of a robot: lines, JSON, exit status; checks of the host."""

from __future__ import annotations

import json
from pathlib import Path
import time
from types import SimpleNamespace

from benchmarks.faults import interrupted
import pytest
from smart_tire.bags.cdr import empty, Encoder
from smart_tire.cli import _live_checks
from smart_tire.cli._live_checks import (
    await_inputs, disk_finding, disk_findings, Heard, host_findings, lateness_finding, Listened,
    load_finding, robot_findings, status_findings, timer_lateness)
from smart_tire.cli.doctor import status_of
from smart_tire.cli.main import main
from smart_tire.findings import Finding, Level
from smart_tire.host_load import EXPLAINED, host_load, HostLoad
from smart_tire.messages import NodeStatus, TOPICS
from smart_tire.samples import Icr
from support.checked import changed, clean, texts
from support.recordings import write_bag


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Return the bag of a clean drive."""
    return write_bag(tmp_path_factory.mktemp('doctor') / 'drive', clean())


def test_a_clean_bag_has_exit_status_0(bag, capsys):
    assert main(['doctor', str(bag)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1] == '0 errors, 0 warnings'
    assert any(line.startswith('ok      wheel_radius: 0.087 m fits') for line in lines)
    assert '\x1b' not in ''.join(lines)


def test_an_error_in_json_has_exit_status_1(bag, tmp_path, capsys):
    params = tmp_path / 'mine.yaml'
    params.write_text('/**: {ros__parameters: {wheel_radius: 0.3}}')
    assert main(['doctor', str(bag), '--json', '--params', str(params)]) == 1
    tree = json.loads(capsys.readouterr().out)
    error, = (one for one in tree['findings'] if one['level'] == 'error')
    assert tree['level'] == 'error' and error['where'] == 'wheel_radius'
    assert error['expected'] == '0.3 m as configured' and error['action']


def test_an_unknown_parameter_is_a_finding(bag, tmp_path, capsys):
    params = tmp_path / 'wrong.yaml'
    params.write_text('/**: {ros__parameters: {wheel_radios: 0.3}}')
    assert main(['doctor', str(bag), '--params', str(params)]) == 1
    out = capsys.readouterr().out
    assert 'error   parameters:' in out and 'wheel_radios' in out and 'wheel_radius: 0.087' in out


def test_a_bag_without_inputs_has_errors(tmp_path, capsys):
    bag = write_bag(tmp_path / 'bag', [(10, 'icr', Icr(10, 1.0, 0.0))])
    assert main(['doctor', str(bag)]) == 1
    assert capsys.readouterr().out.count('no messages') == 3


@pytest.mark.parametrize('level, status', [
    (Level.INFO, 0), (Level.WARNING, 0), (Level.ERROR, 1)])
def test_warnings_are_no_errors(level, status):
    assert status_of([Finding(Level.OK, 'a', 'b'), Finding(level, 'a', 'b')]) == status
    assert status_of([]) == 0


def test_live_samples_are_checked_per_namespace():
    heard = Heard()
    imu = changed('imu/data', lambda one: one)
    encode = Encoder(TOPICS['imu/data'].type)
    for _, topic, sample in imu[:600]:
        if topic == 'imu/data':
            heard.on_message('/robot/imu/data', encode(
                TOPICS[topic].to_msg(empty(TOPICS[topic].type), sample)))
    heard.on_message('/robot/odom', b'not read')
    heard.on_message('/other', b'12345')
    text = texts(robot_findings(heard, []))
    assert 'ERROR /robot: wheel_states: no messages' in text and 'start its driver' in text
    assert 'OK /robot: imu/data: gravity 9.' in text
    assert 'WARNING /robot: imu/data: timestamps are' in text  # those of the simulation
    assert list(heard.robots) == ['/robot'] and heard.size > 13


@pytest.mark.parametrize('level, text', [
    (0, 'ok'), (1, 'warning'), (2, 'error'), (3, 'error'), (9, 'error')])
def test_levels_of_diagnostics_become_levels_of_findings(level, text):
    heard = Heard(statuses={'a/imu_driver': NodeStatus('a/imu_driver', level, 'why', {})})
    finding, = status_findings(heard)
    assert (finding.level.name.lower(), finding.text) == (text, 'node a/imu_driver: why')


@pytest.mark.parametrize('block, expected', [
    ('/**/film_driver: {ros__parameters: {port: /dev/film}}', True),
    ('/**: {ros__parameters: {wheel_radius: 0.1}}', False)])
def test_the_port_of_a_film_is_checked_where_it_is_configured(
        block, expected, monkeypatch, tmp_path):
    monkeypatch.setattr('smart_tire.drivers.port_scan.serial_devices', list)
    params = tmp_path / 'ports.yaml'
    params.write_text(block)
    finding, = _live_checks._port_findings([params])
    assert ('/dev/film' in finding.expected) == expected


def test_without_rclpy_host_and_ports_are_checked(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(_live_checks, 'find_spec', lambda name: None)
    monkeypatch.setattr(_live_checks, 'timer_lateness', lambda: [0.031])
    monkeypatch.setattr(_live_checks, 'disk_findings', lambda folder, rate: [
        Finding(Level.OK, 'disk', f'{rate:g}')])
    monkeypatch.setattr('smart_tire.drivers.port_scan.serial_devices', list)
    params = tmp_path / 'ports.yaml'
    params.write_text('/**/imu_driver: {ros__parameters: {port: /dev/none}}')
    assert main(['doctor', '--params', str(params)]) == 0
    printed = capsys.readouterr()
    assert 'rclpy is not installed' in printed.out and 'disk: 300000' in printed.out
    assert printed.out.startswith('warning host: timers late by 31 ms (99%), load ')
    assert 'warning ports: this machine has no serial port' in printed.out
    assert '/dev/none' in printed.out


class Clock:
    """A clock that its sleeps advance, each by 1 ms more than asked for, the tenth by 30 ms."""

    def __init__(self):
        self.now, self.sleeps = 0.0, 0

    def sleep(self, seconds):
        self.sleeps += 1
        self.now += seconds + (0.030 if self.sleeps == 10 else 0.001)

    def read(self):
        return self.now


def test_lateness_is_measured_per_sleep():
    clock = Clock()
    late = timer_lateness(clock.sleep, clock.read)
    assert len(late) == clock.sleeps == 200
    assert late[0] == pytest.approx(0.001) and late[-1] == pytest.approx(0.030)
    assert late[-2] == pytest.approx(0.001)


@pytest.mark.parametrize('late, level', [
    ([0.001] * 199 + [0.049], Level.OK), ([0.001] * 199 + [0.051], Level.WARNING),
    ([0.009] * 200, Level.OK), ([0.011] * 200, Level.WARNING)])
def test_late_timers_are_a_warning(late, level):
    assert lateness_finding(host_load(late)).level is level


def heard_of(own, *statuses):
    """Return what was heard, with rows (name, level, message, explained part, lateness)."""
    return Heard(own=HostLoad(own, own, 1.0, 2), statuses={name: NodeStatus(
        name, level, message, {EXPLAINED: explained, **{
            key: str(value) for key, value in HostLoad(late, late, 36.0, 2).values.items()}})
        for name, level, message, explained, late in statuses})


LATE_NODE = 'imu_driver', 1, str(HostLoad(0.031, 0.031, 36.0, 2)), '', 0.031
DROPPED = '4 messages dropped'


@pytest.mark.parametrize('own, nodes, said', [
    (0.001, [LATE_NODE], 'timers late by 31 ms (99%), load 36.0 on 2 cores: end other programs'),
    (0.025, [], 'timers late by 25 ms (99%), load 1.0 on 2 cores: end other programs'),
    (0.040, [LATE_NODE], 'timers late by 40 ms (99%), load 1.0 on 2 cores: end other programs')])
def test_a_late_host_is_one_finding_without_its_consequences(own, nodes, said):
    heard = heard_of(own, *nodes, ('estimator', 1, DROPPED, DROPPED, 0.001),
                     ('motor_driver', 2, f'port lost; {DROPPED}', DROPPED, 0.001))
    assert texts([*host_findings(heard), *status_findings(heard)]).splitlines() == [
        f'WARNING host: {said}', 'ERROR node motor_driver: port lost']


def test_on_a_punctual_host_everything_is_reported():
    heard = heard_of(0.001, ('estimator', 1, DROPPED, DROPPED, 0.001))
    assert texts([*host_findings(heard), *status_findings(heard)]).splitlines() == [
        'OK host: timers are late by 1.0 ms (99%), 1.0 ms at worst',
        'OK host: load 1.00 on 2 cores',
        f'WARNING node estimator: {DROPPED}']


@pytest.mark.parametrize('published, looks', [
    (['/imu/data', '/odom'], 1), (['/imu/data', '/r/wheel_states'], 4), (['/tire_samples'], 9)])
def test_inputs_that_nodes_publish_are_awaited_on_a_late_host(monkeypatch, published, looks):
    """The first input is received at the first look, the second at the fourth, others never."""
    now, received, spins = [100.0], set(), []
    order = {1: '/imu/data', 4: '/r/wheel_states'}

    def spin(seconds):
        spins.append(seconds)
        now[0] += seconds
        received.update([order[len(spins)]] if len(spins) in order else [])

    node = SimpleNamespace(get_topic_names_and_types=lambda: [
        (name, ()) for name in ('/scan', '/tire_battery', '/r2/imu/data', *published)],
        count_publishers=lambda name: name != '/r2/imu/data')
    monkeypatch.setattr(_live_checks, 'MAX_DISCOVERY_TIME', 8.5 * _live_checks.SPIN_TIME)
    monkeypatch.setattr(time, 'monotonic', lambda: now[0])
    await_inputs(SimpleNamespace(node=node, spin=spin), received)
    assert len(spins) == looks


@pytest.mark.parametrize('late, count', [(0.001, 1), (0.031, 0)])
def test_gaps_of_a_robot_on_a_late_host_are_not_reported(late, count):
    heard = heard_of(late)
    heard.robots[''] = Listened()
    for receive_ns, _, sample in interrupted(clean(), 'imu/data', [(10.0, 10.4)]):
        heard.robots[''].samples.add_sample(sample, receive_ns)
    found = [one for one in robot_findings(heard, []) if one.level >= Level.WARNING]
    assert [one.where for one in found] == ['imu/data'] * count


@pytest.mark.parametrize('load, level', [(1.5, Level.OK), (1.7, Level.WARNING)])
def test_a_busy_host_is_a_warning(load, level):
    assert load_finding(load, 2).level is level


@pytest.mark.parametrize('free, speed, level', [
    (3.7e9, 5.1e6, Level.OK), (3.5e9, 5.1e6, Level.WARNING), (3.7e9, 4.9e6, Level.WARNING)])
def test_space_and_speed_of_the_disk_are_compared_with_a_recording(free, speed, level):
    finding = disk_finding('disk', free, speed, 1e6)
    assert finding.level is level
    assert '1.0 h of recording at 1.00 MB/s' in finding.found


def test_a_writable_folder_is_measured_and_a_missing_one_an_error(tmp_path):
    found, = disk_findings(tmp_path, 1e3)
    assert found.level is Level.OK and not list(tmp_path.iterdir())
    found, = disk_findings(Path('/no/such/folder'), 1e3)
    assert found.level is Level.ERROR
