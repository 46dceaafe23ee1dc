# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What each verb that reads bags says of one that contradicts itself, or has other contents."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec

import pytest
from smart_tire.bags import BagWriter, channel_of
from smart_tire.cli.main import main
from smart_tire.parameters import build, SimulatorParams
from smart_tire.simulation.offline import simulate
from support.recordings import write_bag

VERBS = {'doctor': [], 'analyze': ['--no-figures', '--out'], 'report': ['--out'],
         'view': ['--save'], 'calibrate': ['--out']}
REFUSED = {'doctor': 1, 'analyze': 1, 'report': 1, 'view': 1, 'calibrate': 1}


def command(verb, bag, out, *words):
    """Return the exit status of a verb that reads ``bag`` and writes to ``out``."""
    if verb == 'view' and find_spec('rerun') is None:
        pytest.skip('needs rerun')
    options = [*VERBS[verb], *[str(out)] * bool(VERBS[verb])]
    return main([verb, *['--bags'] * (verb == 'calibrate'), str(bag), *options, *map(str, words)])


@pytest.fixture(scope='module')
def recorded(tmp_path_factory):
    """Return a drive whose acceleration is in g, and a file with its wheel radius."""
    folder = tmp_path_factory.mktemp('strange')
    (folder / 'robot.yaml').write_text('/**: {ros__parameters: {wheel_radius: 0.087}}')
    return write_bag(folder / 'drive', [
        (received, topic, replace(sample, acceleration=tuple(
            one / 9.80665 for one in sample.acceleration)) if topic == 'imu/data' else sample)
        for received, topic, sample in simulate(
            build(SimulatorParams, {'film.wheels': [], 'seed': 2}), [(3.0, 100.0, 60.0)], 6.0)
    ]), folder / 'robot.yaml'


@pytest.mark.parametrize('verb', [verb for verb in VERBS if verb != 'doctor'])
def test_a_contradiction_gives_status_four_with_the_results(verb, recorded, tmp_path, capsys):
    bag, params = recorded
    status = command(verb, bag, tmp_path / 'a', '--params', params, '--no-checks')
    assert status in (0, 1) and 'in g' not in capsys.readouterr().out  # 1: diverged
    assert command(verb, bag, tmp_path / 'b', '--params', params) == (status or 4)
    lines = capsys.readouterr().out.splitlines()
    assert sum(line.startswith('error: imu/data: specific force is ') and 'in g' in line
               for line in lines) == 1
    assert (tmp_path / 'a').exists() and (tmp_path / 'b').exists()


@pytest.mark.parametrize(('encoding', 'way_on'), [
    ('cdr', 'record this topic, or select it by its name with --remap'),
    ('json', 'smart_tire.bags.BagWriter.write_sample'), ('ros1', 'with rosbags-convert')])
@pytest.mark.parametrize('verb', VERBS)
def test_a_bag_without_inputs_is_listed_with_a_way_on(verb, encoding, way_on, tmp_path, capsys):
    name, kind = ('/scan', 'sensor_msgs/msg/LaserScan') if encoding == 'cdr' else (
        '/imu/data', 'sensor_msgs/msg/Imu')
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic(replace(channel_of('/imu/data', 'sensor_msgs/msg/Imu'), topic=name,
                                 type=kind, encoding=encoding))
        for k in range(3):
            writer.write(name, k, b'{}')
    assert command(verb, tmp_path / 'bag', tmp_path / 'out') == REFUSED[verb]
    said = [line for line in capsys.readouterr().out.splitlines() if 'the bag has' in line]
    assert len(said) == 1 and said[0].endswith(way_on)
    assert f'; the bag has {name} ({kind}{f" in {encoding}" * (encoding != "cdr")}, 3)' in said[0]
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize('verb', VERBS)
def test_a_file_that_is_no_bag_has_a_way_on(verb, tmp_path, capsys):
    (tmp_path / 'old').mkdir()
    (tmp_path / 'old' / 'a.bag').write_bytes(b'#ROSBAG V2.0\n')
    bag = write_bag(tmp_path / 'bag', [])
    for path, way_on in ((tmp_path / 'old', 'a ROS 1 bag; convert it: rosbags-convert --src '),
                         (bag / 'metadata.yaml', f'describes a bag: give its folder {bag}')):
        assert command(verb, path, tmp_path / 'out') == 2
        line, = capsys.readouterr().err.splitlines()
        assert way_on in line
