# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Parameters of real nodes: empty lists, named instances, precedence and refusal."""

from __future__ import annotations

import pytest
from rclpy.parameter import Parameter
from smart_tire.errors import ParameterError
from smart_tire.nodes.friction_estimator import FrictionEstimatorNode
from smart_tire.nodes.parameters import with_number
from smart_tire.nodes.robot_simulator import RobotSimulator
from support.virtual_node import local

pytestmark = pytest.mark.processes

ISLAND = """
/**:
  ros__parameters:
    film.positions: []
robot_simulator:
  ros__parameters:
    ground:
      base: concrete
      patches:
        names: [island]
        island: {surface: sand, x: [1, 2], y: [-1.5, 1.5]}
        unused: {surface: no such surface}
"""
WITHOUT_PATCHES = 'robot_simulator: {ros__parameters: {ground.patches.names: []}}'


@pytest.fixture
def start(isolated_ros, tmp_path):
    """Return a function that starts a node with parameter files of these texts."""
    def start_with(node_class, *texts, **parameters):
        words = []
        for number, text in enumerate(texts):
            path = tmp_path / f'{number}.yaml'
            path.write_text(text)
            words += ['--params-file', str(path)]
        if node_class is RobotSimulator:
            parameters = {f'ports__{port}': tmp_path / port
                          for port in ('tire_radio', 'imu', 'motors')}
        return local(node_class, *words, **parameters)

    return start_with


def values(node, prefix=''):
    """Return name -> value of the parameters of ``node``."""
    return {name: item.value if isinstance(item.value, str) else list(item.value or [])
            for name, item in node.get_parameters_by_prefix(prefix).items()
            if not isinstance(item.value, (int, float))}


@pytest.mark.parametrize('name, text, value', [
    ('load_sigma', '5e-05', 5e-05), ('load_sigma', '[0.5, 1e3]', [0.5, 1000.0]),
    ('load_sigma', 'much', 'much'), ('load_sigma', '[1', '[1'), ('load_sigma', 'true', 'true'),
    ('reliability', '5e-05', '5e-05'), ('other', '5e-05', '5e-05')])
def test_text_is_a_number_if_the_parameter_is_one(start, name, text, value):
    with start(FrictionEstimatorNode) as node:
        found = with_number(node, Parameter(name, value=text))
        assert (found.name, found.value) == (name, value)


def test_patches_are_parameters_of_the_names_in_the_list(start):
    with start(RobotSimulator, ISLAND) as node:
        assert values(node, 'ground.patches') == {
            'names': ['island'], 'island.surface': 'sand', 'island.x': [1.0, 2.0],
            'island.y': [-1.5, 1.5]}


def test_a_later_file_empties_the_list_of_patches(start):
    with start(RobotSimulator, ISLAND, WITHOUT_PATCHES) as node:
        assert [*values(node, 'ground.patches')] == ['names']


@pytest.mark.parametrize(('text', 'message'), [
    ('surfce: sand', 'unknown parameter ground.patches.island.surfce, did you mean'),
    ('surface: ice', "ground.patches.island.surface: 'ice', expected one of"),
    ('x: [2.0, 1.0]', 'ground.patches.island.x: [2.0, 1.0], expected [minimum, maximum]'),
])
def test_an_invalid_patch_is_refused(start, text, message):
    change = f'/**: {{ros__parameters: {{ground: {{patches: {{island: {{{text}}}}}}}}}}}'
    with pytest.raises(ParameterError) as error, start(RobotSimulator, ISLAND, change):
        pass
    assert message in str(error.value)


@pytest.mark.parametrize('source', ['file', 'argument'])
def test_an_empty_list_replaces_an_earlier_one(start, source):
    first = '/**: {ros__parameters: {film.positions: [0.0, 0.02], reliability: best_effort}}'
    second = '/**: {ros__parameters: {film.positions: []}}'
    given = start(FrictionEstimatorNode, first, second) if source == 'file' else start(
        FrictionEstimatorNode, first, film__positions='[]')
    with given as node:
        assert (values(node)['film.positions'], values(node)['reliability']) == (
            [], 'best_effort')
