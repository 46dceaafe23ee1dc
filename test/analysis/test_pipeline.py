# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Parameters of several nodes as the text of one parameter file."""

from __future__ import annotations

import pytest

from smart_tire.analysis.pipeline import bag_params, EstimatorParams
from smart_tire.bags import Bag, BagWriter, PARAMETERS_KEY
from smart_tire.errors import ParameterError
from smart_tire.parameters import build, load_files, NODE_PARAMS, SimulatorParams, specs
from smart_tire.parameters.files import blocks_in, snapshot_text, values_for
from smart_tire.parameters.spec import known_names, values_of


@pytest.mark.parametrize('node', NODE_PARAMS)
def test_the_values_of_parameters_build_equal_ones(node):
    params = NODE_PARAMS[node]()
    assert build(NODE_PARAMS[node], values_of(params)) == params
    assert values_of(params).keys() == specs(NODE_PARAMS[node]).keys()


def test_named_instances_are_among_the_values():
    values = {'ground.patches.names': ['road'], 'ground.patches.road.x': [-1.0, 2.0],
              'ground.patches.road.y': [0.0, 1.0], 'ground.patches.road.surface': 'sand'}
    params = build(SimulatorParams, values)
    found = values_of(params)
    assert found['ground.patches.road.x'] == [-1.0, 2.0]
    assert build(SimulatorParams, found) == params


def test_a_snapshot_is_a_parameter_file_with_common_values_once(tmp_path):
    slip, friction = EstimatorParams().by_node().values()
    slip = {**slip, 'mass': 12.0, 'track_width': 0.5, 'film.positions': [0.0, 0.1]}
    friction = {**friction, 'mass': 12.0, 'film.positions': [0.0, 0.1]}
    text = snapshot_text({'slip_estimator': slip, 'friction_estimator': friction})
    assert text.count(' mass: ') == 1 and text.count(' track_width: ') == 2
    blocks = blocks_in(text, 'bag')
    file = tmp_path / 'params.yaml'
    file.write_text(text)
    known = known_names(NODE_PARAMS.values())
    for node, values in (('slip_estimator', slip), ('friction_estimator', friction)):
        own = known_names([NODE_PARAMS[node]])
        assert values_for(node, blocks, own) == values == load_files([file], node, known, own)
    assert snapshot_text({}) == ''


def test_values_of_a_single_node_apply_to_all_estimators():
    text = snapshot_text({'wheel_controller': {'wheel_radius': 0.2, 'rate': 20.0}})
    params = EstimatorParams.from_text(text, 'bag')
    assert (params.slip.robot.wheel_radius, params.friction.robot.wheel_radius) == (0.2, 0.2)


def bag_with(path, text):
    with BagWriter(path, custom_data={PARAMETERS_KEY: text}):
        return path


def test_unknown_names_of_another_version_are_a_warning(tmp_path):
    text = snapshot_text({'slip_estimator': {'wheel_radius': 0.2, 'future.gain': 1.0}})
    with Bag(bag_with(tmp_path / 'bag', text)) as bag:
        source = bag_params(bag)
    assert (source.params.robot.wheel_radius, source.unknown) == (0.2, ('future.gain',))
    assert list(source.lines()) == [
        'parameters: from the bag (recorded with slip_estimator)',
        'warning: parameters in the bag are unknown to this version and ignored: future.gain']


def test_a_text_given_to_ros2_bag_record_is_used_as_a_parameter_file_is(tmp_path):
    text = '/**:\n  ros__parameters:\n    wheel_radius: 0.2\n    imu: {position: [0, 0, 1]}\n'
    with Bag(bag_with(tmp_path / 'bag', text)) as bag:
        source = bag_params(bag)
    robot = source.params.robot
    assert (robot.wheel_radius, robot.imu.position) == (0.2, (0.0, 0.0, 1.0))
    assert list(source.lines()) == ['parameters: from the bag']


def test_an_invalid_value_in_a_bag_is_an_error_that_files_avoid(tmp_path):
    text = snapshot_text({'slip_estimator': {'wheel_radius': -0.2}})
    file = tmp_path / 'robot.yaml'
    file.write_text('{}')
    with Bag(bag_with(tmp_path / 'bag', text)) as bag:
        with pytest.raises(ParameterError, match=r'bag: parameters in the bag: .*wheel_radius.*'
                                                 r'give a parameter file with --params'):
            bag_params(bag)
        source = bag_params(bag, [file])
    assert (source.source, source.overridden) == ('files', True)
    assert source.params == EstimatorParams()


def test_a_bag_without_parameters_is_analyzed_with_the_defaults(tmp_path):
    with BagWriter(tmp_path / 'bag'):
        pass
    with Bag(tmp_path / 'bag') as bag:
        source = bag_params(bag)
    tree = source.tree
    values = tree.pop('values')['slip_estimator'].values()
    assert tree == {'source': 'defaults'} and source.params == EstimatorParams()
    assert {one['origin'] for one in values} == {'default'}
    assert 'defaults' in next(source.lines())
