# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire map``: bags and analyses to a map, refusals."""

from __future__ import annotations

from argparse import Namespace
import math
from shutil import copytree

import numpy as np
import pytest
from smart_tire.api import load_params, simulate, write_bag
from smart_tire.bags import Bag, BagWriter, channel_of
from smart_tire.cli.main import main
from smart_tire.cli.map import track_of
from smart_tire.mapping.raster import read_raster
from smart_tire.parameters import load_node
import yaml


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Return a short drive with turns, as a bag."""
    made, written = (tmp_path_factory.mktemp('map') / name for name in ('drive', 'written'))
    speeds = [[0.0, 0.0, 0.0], *([1.0 + 1.5 * i, *((9.0, 6.0) if i % 2 else (6.0, 9.0))]
                                 for i in range(4))]
    write_bag(written, simulate(speeds, 7.0, params=load_params(values={
        'ground.base': 'concrete', 'film.wheels': ['front_left', 'front_right']}), seed=5))
    with Bag(written) as bag, BagWriter(made, custom_data=bag.custom_data) as writer:
        for receive_ns, channel, data in bag.raw():
            writer.add_topic(channel_of(f'/r7{channel.topic}', channel.type))
            writer.write(f'/r7{channel.topic}', receive_ns, data)
    return made


def test_a_bag_and_its_analysis_give_the_same_map(bag, tmp_path, capsys):
    assert main(['map', str(bag), '--out', str(tmp_path / 'a'), '--stop-within', '0.2']) == 0
    assert 'cells of 0.1 m in odom, from 1 drives' in capsys.readouterr().out
    assert main(['analyze', str(bag), '--no-figures', '--no-checks',
                 '--out', str(tmp_path / 'analyzed')]) == 0
    assert main(['map', str(tmp_path / 'analyzed'), '--out', str(tmp_path / 'b')]) == 0
    used = Namespace(params=[], remap=[])
    one, other = (track_of(path, 'a', used, None)[1] for path in (bag, tmp_path / 'analyzed'))
    assert one.robot == other.robot == 'r7'
    np.testing.assert_array_equal(one.friction, other.friction)
    first, second = (read_raster(tmp_path / one / 'friction_map.yaml') for one in 'ab')
    np.testing.assert_array_equal(first.friction, second.friction)
    known = np.isfinite(first.friction)  # 3 m with known friction: 30 cells of each side
    error = np.abs(first.friction - 0.47)[known]
    assert known.sum() > 70 and np.mean(error < 2.0 * first.sigma[known] + 0.01) > 0.95
    mask = yaml.safe_load((tmp_path / 'a' / 'speed_mask.yaml').read_text())
    assert mask['mode'] == 'raw' and not (tmp_path / 'b' / 'speed_mask.yaml').exists()
    assert math.isfinite(load_node([], 'trajectory_controller').max_speed)
    capsys.readouterr()
    assert main(['map', str(tmp_path / 'analyzed'), '--out', str(tmp_path / 'b')]) == 2
    assert '--force' in capsys.readouterr().err
    assert main(['map', str(tmp_path / 'analyzed'), '--out', str(tmp_path / 'b'), '--force',
                 '--resolution', '0.5']) == 0
    assert read_raster(tmp_path / 'b' / 'friction_map.yaml').resolution == 0.5


def test_a_folder_of_bags_in_processes_gives_the_map_of_its_bags(bag, tmp_path, capsys):
    for name in 'first', 'second':
        copytree(bag, tmp_path / 'bags' / name)
    (tmp_path / 'bags' / 'damaged.mcap').write_bytes(b'no bag')
    assert main(['map', str(tmp_path / 'bags'), '--jobs', '2', '--out', str(tmp_path / 'a')]) == 2
    printed = capsys.readouterr()
    assert 'from 2 drives' in printed.out and 'damaged.mcap' in printed.err
    both = [str(tmp_path / 'bags' / name) for name in ('first', 'second')]
    assert main(['map', *both, '--jobs', '1', '--out', str(tmp_path / 'b')]) == 0
    one, other = ((tmp_path / out / 'friction_map.csv').read_bytes() for out in 'ab')
    assert one == other
    drives = np.loadtxt(tmp_path / 'a' / 'friction_map.csv', delimiter=',', skiprows=1)
    assert drives.max() > 1.0


def test_an_output_in_the_bag_and_a_bag_that_is_missing_are_refused(bag, tmp_path, capsys):
    assert main(['map', str(bag), '--out', str(bag / 'map')]) == 2
    assert main(['map', str(tmp_path / 'none'), '--out', str(tmp_path / 'c')]) == 2
    assert not (tmp_path / 'c').exists()
    assert len(capsys.readouterr().err.splitlines()) == 2
