# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The files in ``config/`` and the page of parameters agree with the parameter classes."""

from __future__ import annotations

from pathlib import Path
import re

from config_files import file_text, SIMULATED_PORTS, TITLES
import numpy as np
from parameters_page import MARKER, parameters_text
import pytest
import simulated_film
from smart_tire.errors import ParameterError
from smart_tire.estimation.film.calibration import PRODUCTS, read_params
from smart_tire.parameters import (
    build, known_names, load_files, load_node, NODE_PARAMS, RobotParams, specs)
import yaml

OTHER_FILES = {'rosbag2_qos.yaml'}  # without parameters: test/nodes/test_qos.py
CONFIG = Path(__file__).resolve().parents[1] / 'config'
CALIBRATION = CONFIG / 'calibration' / 'simulated_film.yaml'
REFERENCE = CONFIG.parent / 'docs' / 'parameters.md'
PATHS = [CONFIG / name for name in TITLES]
ROBOT_PATHS = [path for path in PATHS if path.name != 'simulation.yaml']
KNOWN = known_names(NODE_PARAMS.values())

every_node = pytest.mark.parametrize('node', NODE_PARAMS)


def test_the_files_are_the_listed_ones():
    found = {path.name for path in CONFIG.iterdir() if path.is_file()}
    assert found == TITLES.keys() | OTHER_FILES


@pytest.mark.parametrize('name', TITLES)
def test_each_file_is_current(name):
    assert (CONFIG / name).read_text(encoding='utf-8') == file_text(name), 'run: make config'


def test_the_calibration_of_the_simulated_film_is_current(tmp_path):
    simulated_film.write(tmp_path / 'film.yaml')
    found, written = read_params(CALIBRATION), read_params(tmp_path / 'film.yaml')
    assert found.film == written.film
    for name in (*PRODUCTS, 'noise', 'model_error'):
        assert getattr(found, name) == pytest.approx(getattr(written, name), rel=1e-4), name
    sigmas = np.sqrt([np.diag(one.covariance) for one in (found, written)])
    assert sigmas[0] == pytest.approx(sigmas[1], rel=1e-3)


def test_the_reference_has_every_parameter_once():
    assert MARKER in REFERENCE.read_text(encoding='utf-8')
    names = re.findall(r'^\| `([^`]+)` \|', parameters_text(), re.M)
    expected = [name.replace('start_area', '<name>') for cls in NODE_PARAMS.values()
                for name in specs(cls) if name not in specs(RobotParams)]
    assert sorted(names) == sorted([*specs(RobotParams), *expected])
    assert 'ground.patches.<name>.surface' in names


def given_to(node, paths):
    """Return the parameters that the files at ``paths`` set for ``node``."""
    return load_files(paths, node, KNOWN, known_names([NODE_PARAMS[node]]))


def paths_for(node):
    """Return the parameter files of ``node``."""
    return PATHS if node.endswith('_simulator') else ROBOT_PATHS


@every_node
def test_the_files_hold_every_parameter_of_a_node(node):
    assert given_to(node, paths_for(node)).keys() == specs(NODE_PARAMS[node]).keys()


@every_node
def test_the_files_change_no_default(node):
    given = given_to(node, paths_for(node))
    assert build(NODE_PARAMS[node], given) == NODE_PARAMS[node]()
    assert {name: spec.check(given[name]) for name, spec in specs(NODE_PARAMS[node]).items()} \
        == {name: spec.default for name, spec in specs(NODE_PARAMS[node]).items()}


@pytest.mark.parametrize('node', SIMULATED_PORTS)
def test_in_simulation_a_driver_opens_the_port_that_the_simulator_links(node):
    link = given_to('robot_simulator', PATHS)[SIMULATED_PORTS[node]]
    assert given_to(node, PATHS)['port'] == link
    assert given_to(node, [CONFIG / 'simulation.yaml']) == {'port': link}


@every_node
def test_values_have_the_types_that_rcl_infers(node):
    described = specs(NODE_PARAMS[node])
    for name, value in given_to(node, PATHS).items():
        items = value if isinstance(value, list) else [value]
        assert {type(item).__name__ for item in items} \
            <= {described[name].kind.removesuffix('[]')}, name  # an empty list has no type


def test_blocks_match_nodes_in_any_namespace():
    for path in PATHS:
        for block in yaml.safe_load(path.read_text(encoding='utf-8')):
            assert block.startswith('/**')


def test_blocks_for_the_nodes_of_other_packages_are_ignored(tmp_path):
    path = tmp_path / 'stack.yaml'
    path.write_text("""
/**: {ros__parameters: {wheel_radius: 0.1}}
controller_server: {ros__parameters: {controller_frequency: 20.0, FollowPath: {max_vel_x: 0.5}}}
local_costmap: {local_costmap: {ros__parameters: {width: 3}}}
""")
    assert load_node([path], 'slip_estimator').robot.wheel_radius == 0.1
    path.write_text('/**: {ros__parameters: {wheel_radios: 0.1}}')
    with pytest.raises(ParameterError, match='wheel_radios'):
        load_node([path], 'slip_estimator')
