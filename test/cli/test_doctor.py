# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Doctor of a bag and of a robot: lines, JSON and exit status."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest
from smart_tire.bags.cdr import empty, Encoder
from smart_tire.cli import _live_checks
from smart_tire.cli._live_checks import Heard, robot_findings, status_findings
from smart_tire.cli.doctor import status_of
from smart_tire.cli.main import main
from smart_tire.findings import Finding, Level
from smart_tire.messages import TOPICS
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


def test_a_missing_bag_has_exit_status_2(capsys):
    assert main(['doctor', '/no/such/bag']) == 2
    assert 'no such file' in capsys.readouterr().err


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
    heard = Heard(statuses={'a/imu_driver': SimpleNamespace(level=level, message='why')})
    finding, = status_findings(heard)
    assert (finding.level.name.lower(), finding.text) == (text, 'node a/imu_driver: why')


def test_without_rclpy_host_and_ports_are_checked(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(_live_checks, 'find_spec', lambda name: None)
    monkeypatch.setattr(_live_checks, 'host_findings', lambda folder, rate: [
        Finding(Level.OK, 'host', f'{rate:g}')])
    monkeypatch.setattr('smart_tire.drivers.port_scan.serial_devices', list)
    params = tmp_path / 'ports.yaml'
    params.write_text('/**/imu_driver: {ros__parameters: {port: /dev/none}}')
    assert main(['doctor', '--params', str(params)]) == 0
    printed = capsys.readouterr()
    assert 'rclpy is not installed' in printed.out and 'host: 300000' in printed.out
    assert 'warning ports: this machine has no serial port' in printed.out
    assert '/dev/none' in printed.out
