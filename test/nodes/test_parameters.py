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
from support.graph import node_arguments, Process

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
WITHOUT_PATCHES = """
robot_simulator:
  ros__parameters:
    ground.patches.names: []
"""


def values(graph, node, *names):
    """Return name -> value of parameters of ``node``, as ROS reports them."""
    reported = graph.call('rcl_interfaces/srv/GetParameters', f'{node}/get_parameters',
                          names=list(names)).values
    return {name: list(value.string_array_value) or list(value.double_array_value)
            or value.string_value for name, value in zip(names, reported)}


@pytest.fixture
def start(graph, tmp_path):
    """Return a function that starts a simulator with parameter files of these texts."""
    def start_with(*texts):
        arguments = [*node_arguments('robot_simulator')]
        for number, text in enumerate(texts):
            path = tmp_path / f'{number}.yaml'
            path.write_text(text)
            arguments += ['--params-file', str(path)]
        for port in ('tire_radio', 'imu', 'motors'):
            arguments += ['-p', f'ports.{port}:={tmp_path / port}']
        return Process(arguments, tmp_path / 'log')

    return start_with


def test_patches_are_parameters_of_the_names_in_the_list(graph, start):
    with start(ISLAND) as node:
        graph.until(lambda: 'robot_simulator' in graph.health)
        prefix = 'ground.patches'
        assert values(graph, 'robot_simulator', f'{prefix}.names', f'{prefix}.island.surface',
                      f'{prefix}.island.x', f'{prefix}.island.y') == {
            f'{prefix}.names': ['island'], f'{prefix}.island.surface': 'sand',
            f'{prefix}.island.x': [1.0, 2.0], f'{prefix}.island.y': [-1.5, 1.5]}
        reported = graph.call('rcl_interfaces/srv/ListParameters',
                              'robot_simulator/list_parameters').result.names
        assert not any('unused' in name or 'start_area' in name for name in reported)
        assert node.end() == 0


def test_a_later_file_empties_the_list_of_patches(graph, start):
    with start(ISLAND, WITHOUT_PATCHES) as node:
        graph.until(lambda: 'robot_simulator' in graph.health)
        reported = graph.call('rcl_interfaces/srv/ListParameters',
                              'robot_simulator/list_parameters').result.names
        assert [name for name in reported if 'patches' in name] == ['ground.patches.names']
        assert node.end() == 0


@pytest.mark.parametrize(('text', 'message'), [
    ('surfce: sand', 'unknown parameter ground.patches.island.surfce, did you mean'),
    ('surface: ice', "ground.patches.island.surface: 'ice', expected one of"),
    ('x: [2.0, 1.0]', 'ground.patches.island.x: [2.0, 1.0], expected [minimum, maximum]'),
])
def test_an_invalid_patch_is_refused_in_one_line(graph, start, text, message):
    change = f'/**: {{ros__parameters: {{ground: {{patches: {{island: {{{text}}}}}}}}}}}'
    with start(ISLAND, change) as node:
        assert node.ended() == 2
        assert message in node.output
        assert node.output.count('\n') == 1


@pytest.mark.parametrize('source', ['file', 'argument'])
def test_an_empty_list_replaces_an_earlier_one(graph, tmp_path, source):
    first = '/**: {ros__parameters: {film.positions: [0.0, 0.02], reliability: best_effort}}'
    paths = [tmp_path / 'first.yaml', tmp_path / 'second.yaml']
    for path, text in zip(paths, (first, '/**: {ros__parameters: {film.positions: []}}')):
        path.write_text(text)
    last = ['--params-file', str(paths[1])] if source == 'file' else ['-p', 'film.positions:=[]']
    with Process([*node_arguments('friction_estimator'), '--params-file', str(paths[0]), *last],
                 tmp_path / 'log') as node:
        graph.until(lambda: 'friction_estimator' in graph.health)
        assert values(graph, 'friction_estimator', 'film.positions', 'reliability') == {
            'film.positions': '', 'reliability': 'best_effort'}
        assert node.end() == 0
        assert 'Traceback' not in node.output
