# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bags of other robots on the command line: other topics, joints, wheels and sensors."""

from __future__ import annotations

from dataclasses import replace
import json
import math
import re

import pytest
from smart_tire.analysis.pipeline import EstimatorParams
from smart_tire.bags import Bag, PARAMETERS_KEY
from smart_tire.cli.main import main
from smart_tire.parameters import build, SimulatorParams
from smart_tire.samples import WheelSample
from smart_tire.simulation.offline import simulate
from support.foreign import Foreign, IMU, JOINTS

SENSORS = ('imu/data', 'wheel_states', 'ground_truth/odom')
CONTRADICTED = 4  # no file gives the wheel radius, and these drives do not confirm the default
JOINT_BLOCK = '/**: {{ros__parameters: {{joints: {}}}}}'


@pytest.fixture(scope='module')
def events():
    """Return a drive whose wheels of a side have equal measurements, without films."""
    found = []
    for receive_ns, topic, sample in simulate(
            build(SimulatorParams, {'seed': 3}), [(0.5, 100.0, 60.0)], 2.5):
        if isinstance(sample, WheelSample):
            sample = replace(sample, velocity=sample.velocity[:2] * 2, effort=None,
                             position=sample.position[:2] * 2)
        if topic in SENSORS:
            found.append((receive_ns, topic, sample))
    return found


@pytest.fixture(scope='module')
def standard(events, tmp_path_factory):
    """Return the estimates from the standard form of the drive."""
    folder = tmp_path_factory.mktemp('standard')
    bag = Foreign().write(folder / 'bag', events)
    assert analyze(bag, folder / 'out') == CONTRADICTED
    return summary(folder / 'out')['estimates']


def analyze(bag, out, *words):
    return main(['analyze', str(bag), '--no-figures', '--out', str(out), *map(str, words)])


def summary(out):
    return json.loads((out / 'summary.json').read_text())


def test_topics_of_other_names_are_recognized_or_selected(events, standard, tmp_path, capsys):
    topics = {'imu/data': 'mti30/imu', 'wheel_states': 'base/joint_states'}
    bag = Foreign(topics).write(tmp_path / 'bag', events)
    assert analyze(bag, tmp_path / 'out') == CONTRADICTED
    assert summary(tmp_path / 'out')['estimates'] == standard
    output = capsys.readouterr().out
    assert 'imu/data: using /mti30/imu, the only topic of type sensor_msgs/msg/Imu\n' in output
    assert summary(tmp_path / 'out')['notes'] == [
        line for line in output.splitlines() if ': using /' in line]
    assert analyze(bag, tmp_path / 'again', *(word for rule in topics.items() for word in (
        '--remap', ':='.join(rule)))) == CONTRADICTED
    assert summary(tmp_path / 'again')['estimates'] == standard
    assert 'using' not in capsys.readouterr().out


@pytest.mark.parametrize('rule, message', [
    ('imu/data', 'expected STANDARD:=NAME'), ('imu:=/x', 'imu is not a standard topic'),
    ('imu/data:=/nowhere', 'the bag has no /nowhere'),
    ('imu/data:=/wheel_states', f'/wheel_states is {JOINTS}, expected {IMU}')])
def test_an_invalid_remapping_is_refused(events, tmp_path, capsys, rule, message):
    bag = Foreign().write(tmp_path / 'bag', events[:50])
    assert analyze(bag, tmp_path / 'out', '--remap', rule) == 2
    assert message in capsys.readouterr().err


def test_joints_of_other_names_are_given_in_a_parameter_file(events, standard, tmp_path, capsys):
    joints = {'arm': '', 'M1': 'front_left', 'M2': 'front_right', 'M3': 'rear_left',
              'M4': 'rear_right'}
    bag = Foreign({'wheel_states': 'joint_states'}, joints, inverted=('M2', 'M4')).write(
        tmp_path / 'bag', events)
    assert analyze(bag, tmp_path / 'out') == 2
    error = capsys.readouterr().err
    assert '/joint_states: arm, M1, M2, M3, M4' in error
    # The block in the message is a parameter file, once the names are filled in.
    block = re.search(r'/\*\*:.*rear_right: NAME', error, re.DOTALL)[0]
    for name in ('M1', 'M2', 'M3', 'M4'):
        block = block.replace('NAME', name, 1)
    file = tmp_path / 'robot.yaml'
    file.write_text(block + '\n        inverted: [M2, M4]\n')
    assert analyze(bag, tmp_path / 'out', '--params', file) == CONTRADICTED
    assert summary(tmp_path / 'out')['estimates'] == standard
    file.write_text(JOINT_BLOCK.format('{front_left: M1, front_right: M9, rear_left: M3}'))
    assert analyze(bag, tmp_path / 'other', '--params', file) == 2
    assert 'the joints M1, M9, M3, rear_right of the parameters joints.* are not in the bag' in (
        capsys.readouterr().err)


def test_a_two_wheel_drive_equals_four_wheels_of_which_two_are_copies(
        events, standard, tmp_path, capsys):
    joints = {'left_wheel_joint': 'front_left', 'right_wheel_joint': 'front_right'}
    bag = Foreign(joints=joints).write(tmp_path / 'bag', events)
    assert analyze(bag, tmp_path / 'out') == CONTRADICTED
    assert summary(tmp_path / 'out')['estimates'] == standard
    assert ('wheel_states: the wheels are the joints left_wheel_joint, right_wheel_joint, by '
            'their names') in capsys.readouterr().out


def test_messages_without_timestamp_get_that_of_reception(events, tmp_path, capsys):
    at_once = [(sample.stamp_ns, topic, sample) for _, topic, sample in events]
    bag = Foreign(zero_stamps=('wheel_states',)).write(tmp_path / 'bag', at_once)
    same = Foreign().write(tmp_path / 'same', at_once)
    assert analyze(bag, tmp_path / 'out') == analyze(same, tmp_path / 'other') == CONTRADICTED
    assert summary(tmp_path / 'out')['estimates'] == summary(tmp_path / 'other')['estimates']
    note = 'wheel_states: header.stamp is zero, the time of reception is used instead'
    assert capsys.readouterr().out.count(note) == 1
    assert summary(tmp_path / 'out')['notes'] == [note]


def test_parameters_in_the_bag_are_used_like_those_of_a_file(events, tmp_path, capsys):
    file = tmp_path / 'robot.yaml'
    file.write_text('/**: {ros__parameters: {wheel_radius: 0.1, film.wheels: []}}\n'
                    '/**/slip_estimator: {ros__parameters: {lateral_sigma: 0.01}}')
    text = EstimatorParams.load([file]).text
    with_params = Foreign(custom_data={PARAMETERS_KEY: text}).write(tmp_path / 'bag', events)
    without = Foreign().write(tmp_path / 'without', events)
    assert analyze(with_params, tmp_path / 'out') == 0
    assert ('parameters: from the bag (recorded with friction_estimator, slip_estimator)'
            in capsys.readouterr().out)
    assert analyze(without, tmp_path / 'other', '--params', file) == 0
    found, expected = summary(tmp_path / 'out'), summary(tmp_path / 'other')
    assert found['estimates'] == expected['estimates']
    values, origins = (found['parameters'].pop('values'), expected['parameters'].pop('values'))
    assert found['parameters'] == {
        'source': 'bag', 'nodes': ['friction_estimator', 'slip_estimator']}
    assert expected['parameters'] == {'source': 'files', 'files': [str(file)]}
    for node, names in origins.items():
        assert names['wheel_radius'] == {'value': 0.1, 'origin': f'{file}:1'}
        assert values[node]['wheel_radius'] == {'value': 0.1, 'origin': 'the bag'}
        assert {name: one['value'] for name, one in names.items()} == {
            name: one['value'] for name, one in values[node].items()}
    assert origins['slip_estimator']['lateral_sigma']['origin'] == f'{file}:2'
    assert origins['slip_estimator']['slope_sigma']['origin'] == 'default'
    for out in ('out', 'other'):  # the bag of estimates carries them on
        with Bag(tmp_path / out / 'estimates') as bag:
            assert bag.parameters == text
    file.write_text('/**: {ros__parameters: {track_width: 0.4}}')  # replaces all in the bag
    assert analyze(with_params, tmp_path / 'third', '--params', file) == CONTRADICTED
    assert f'parameters: {file} (instead of those in the bag)' in capsys.readouterr().out
    with Bag(tmp_path / 'third' / 'estimates') as bag:
        assert EstimatorParams.from_text(bag.parameters, 'bag') == EstimatorParams.load([file])


def test_bags_of_different_robots_are_not_identified_together(events, tmp_path, capsys):
    bags = []
    for radius in (0.1, 0.2):
        text = f'/**: {{ros__parameters: {{wheel_radius: {radius}}}}}'
        bags.append(str(Foreign(custom_data={PARAMETERS_KEY: text}).write(
            tmp_path / f'bag{radius}', events[:50])))
    assert main(['identify', 'geometry', *bags, '--out', str(tmp_path / 'out.yaml')]) == 2
    assert 'carry different parameters of the robot' in capsys.readouterr().err


def test_the_slip_of_a_wheel_without_encoder_is_unknown(events, standard, tmp_path):
    joints = {'a': 'front_left', 'b': 'front_right', 'c': 'rear_right'}
    bag = Foreign(joints=joints).write(tmp_path / 'bag', events)
    file = tmp_path / 'robot.yaml'
    file.write_text(JOINT_BLOCK.format(
        "{front_left: a, front_right: b, rear_left: '', rear_right: c}"))
    assert analyze(bag, tmp_path / 'out', '--params', file) == CONTRADICTED
    found = summary(tmp_path / 'out')['estimates']
    assert found['odom']['distance_m'] == pytest.approx(standard['odom']['distance_m'], rel=1e-3)
    assert found['wheel_slip']['left']['mean'] == pytest.approx(
        standard['wheel_slip']['left']['mean'], abs=1e-3)
    with Bag(tmp_path / 'out' / 'estimates') as opened:
        slips = [sample for _, _, sample in opened.samples(['wheel_slip'])]
        assert not opened.faults.rejected
    assert all(math.isnan(slip.ratio[2]) and slip.sigma[2] == 1.0 for slip in slips)
    assert sum(math.isfinite(slip.ratio[0]) for slip in slips) > 180
