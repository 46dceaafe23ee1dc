"""The files in ``config/`` say what the parameter classes say, no more and no less."""

from __future__ import annotations

from pathlib import Path
import re

import pytest
import yaml

from smart_tire.parameters import build, known_names, load_files, NODE_PARAMS, RobotParams, specs
from smart_tire.parameters.yaml_writer import file_text, FILES, PLUGGED, write_files

OTHERS = {'rosbag2_qos.yaml'}  # no parameters in it: test/nodes/test_qos.py
CONFIG = Path(__file__).resolve().parents[1] / 'config'
PATHS = [CONFIG / name for name in FILES]
REAL = [path for path in PATHS if path.name != 'simulation.yaml']
KNOWN = known_names(NODE_PARAMS.values())

every_node = pytest.mark.parametrize('node', NODE_PARAMS)


def test_the_files_are_those_that_are_described():
    assert {path.name for path in CONFIG.iterdir()} == FILES.keys() | OTHERS


@pytest.mark.parametrize('name', FILES)
def test_a_file_is_what_the_classes_describe(name):
    assert (CONFIG / name).read_text(encoding='utf-8') == file_text(name), 'run: make config'


def test_writing_the_files_gives_the_same_text(tmp_path):
    write_files(tmp_path)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} \
        == {path.name: path.read_text() for path in PATHS}


def given_to(node, paths):
    """Return what the files at ``paths`` give to ``node``."""
    return load_files(paths, node, KNOWN, specs(NODE_PARAMS[node]))


def paths_for(node):
    """Return the files that ``node`` is started with."""
    return PATHS if node == 'robot_simulator' else REAL


@every_node
def test_the_files_hold_every_parameter_of_a_node(node):
    assert given_to(node, paths_for(node)).keys() == specs(NODE_PARAMS[node]).keys()


@every_node
def test_the_files_change_no_default(node):
    given = given_to(node, paths_for(node))
    assert build(NODE_PARAMS[node], given) == NODE_PARAMS[node]()
    assert {name: spec.check(given[name]) for name, spec in specs(NODE_PARAMS[node]).items()} \
        == {name: spec.default for name, spec in specs(NODE_PARAMS[node]).items()}


@pytest.mark.parametrize('node', PLUGGED)
def test_in_simulation_a_driver_opens_the_port_that_the_simulator_links(node):
    link = given_to('robot_simulator', PATHS)[PLUGGED[node]]
    assert given_to(node, PATHS)['port'] == link
    assert given_to(node, [CONFIG / 'simulation.yaml']) == {'port': link}


@every_node
def test_values_have_the_type_that_ros_will_give_them(node):
    described = specs(NODE_PARAMS[node])
    for name, value in given_to(node, PATHS).items():
        items = value if isinstance(value, list) else [value]
        assert items, f'{name}: ROS can not tell the type of an empty list'
        assert {type(item).__name__ for item in items} \
            == {described[name].kind.removesuffix('[]')}, name


def test_each_parameter_has_its_unit_and_meaning_beside_it():
    text = (CONFIG / 'robot.yaml').read_text(encoding='utf-8')
    for name, spec in specs(RobotParams).items():
        key = name.rsplit('.', 1)[-1]
        unit = '' if spec.unit == '-' else f'{spec.unit}, '
        assert re.search(rf'^ +{key}:.*  # {re.escape(unit + spec.meaning)}', text, re.M), name


def test_a_file_names_a_node_in_any_namespace():
    for path in PATHS:
        for block in yaml.safe_load(path.read_text(encoding='utf-8')):
            assert block.startswith('/**')


def test_no_line_is_too_long():
    for path in PATHS:
        for line in path.read_text(encoding='utf-8').splitlines():
            assert len(line) <= 99, f'{path.name}: {line}'
