"""How nodes start, refuse to start, and end."""

from __future__ import annotations

import signal

import pytest
from support.graph import node_arguments, Process

from smart_tire.parameters import NODE_PARAMS

pytestmark = pytest.mark.processes


@pytest.mark.parametrize('name', NODE_PARAMS)
def test_a_node_tells_how_it_is_and_ends_cleanly_however_often_it_is_told(name, graph, tmp_path):
    ports = {f'ports__{port}': tmp_path / port for port in ('tire_radio', 'imu', 'motors')} \
        if name == 'robot_simulator' else {}
    with graph.start(name, **ports) as node:
        graph.until(lambda: name in graph.health)
        assert node.end(signal.SIGINT, signal.SIGINT, signal.SIGTERM) == 0
        assert 'Traceback' not in node.output


def test_sigterm_is_a_clean_end_too(graph):
    with graph.start('wheel_controller') as node:
        graph.until(lambda: graph.health)
        assert node.end(signal.SIGTERM) == 0
        assert node.output == ''


@pytest.mark.parametrize(('parameters', 'complaint'), [
    ({'ratee': 16.0}, 'unknown parameter ratee, did you mean rate?'),
    ({'rate': 'fast'}, "parameter rate: 'fast', expected a float"),
    ({'rate': 1000}, 'parameter rate: 1000.0, expected 1 to 200 Hz'),
    ({'imu__position': '[1, 2]'}, 'parameter imu.position: '),
    ({'use_sim_time': 'maybe'}, "parameter use_sim_time: 'maybe', expected a bool"),
])
def test_a_bad_parameter_is_refused_in_one_line_that_names_it(parameters, complaint, graph):
    with graph.start('wheel_controller', **parameters) as node:
        assert node.ended() == 2
        assert complaint in node.output
        assert node.output.count('\n') == 1


@pytest.mark.parametrize('words', [
    ['--bogus'], ['use_sim_time:=maybe'], ['--ros-args', '-p', 'rate:=20', '--', '--bogus']])
def test_arguments_that_no_node_takes_are_refused_in_one_line(words, graph, tmp_path):
    with Process(['-m', 'smart_tire.nodes.wheel_controller', *words], tmp_path / 'log') as node:
        assert node.ended() == 2
        assert f'unknown arguments: {words[-1]} (ROS arguments come after' in node.output
        assert node.output.count('\n') == 1


def test_an_unknown_ros_argument_is_refused_by_its_name(graph, tmp_path):
    with Process([*node_arguments('wheel_controller'), '--bogus'], tmp_path / 'log') as node:
        assert node.ended() == 2
        assert "ROS arguments: unknown '--bogus'" in node.output
        assert node.output.count('\n') == 1


@pytest.mark.parametrize(('text', 'complaint'), [
    ('/**:\n  ros__parameters:\n    wheel_radios: 0.1\n', 'did you mean wheel_radius?'),
    ('/**:\n  ros__parameters:\n    units: [broken]\n', "units: 'broken', expected 16 hex digits"),
    ('/**: [', 'params.yaml'),
])
def test_a_bad_parameter_file_is_refused(text, complaint, graph, tmp_path):
    path = tmp_path / 'params.yaml'
    path.write_text(text)
    with Process([*node_arguments('tire_receiver'), '--params-file', str(path)],
                 tmp_path / 'log') as node:
        assert node.ended() == 2
        assert complaint in node.output
        assert 'Traceback' not in node.output


def test_whole_numbers_do_where_numbers_are_wanted(graph):
    with graph.start('wheel_controller', rate=20, imu__position='[0, 0, 1]') as node:
        graph.until(lambda: graph.health)
        assert node.end() == 0


def test_the_simulator_takes_its_ports_away_after_the_drivers_that_use_them(graph, tmp_path):
    """Ctrl-C ends all of them at the same time: a port that vanishes first would be an error."""
    ports = {name: tmp_path / name for name in ('tire_radio', 'imu', 'motors')}
    graph.listen('imu/data')
    with graph.start('robot_simulator', **{f'ports__{name}': path for name, path in ports.items()}
                     ) as simulator, graph.start('imu_driver', port=ports['imu']) as driver:
        graph.until(lambda: graph.heard['imu/data'])
        simulator.popen.send_signal(signal.SIGINT)
        heard = len(graph.heard['imu/data'])
        graph.until(lambda: len(graph.heard['imu/data']) > heard + 60)  # 0.6 s at 100 Hz
        assert driver.end() == 0
        assert simulator.ended() == 0
        assert 'lost' not in driver.output
    assert not ports['imu'].exists()
