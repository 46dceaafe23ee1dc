# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""SROS2 policy of the robot: who may command, and what SROS2 makes of it."""

from __future__ import annotations

from importlib.util import find_spec
import os
from pathlib import Path
import subprocess
import sys
from xml.etree import ElementTree

import pytest
from smart_tire.cli.main import main
from smart_tire.cli.policy import FOREIGN, OBSERVER, OPERATOR, policy
from smart_tire.messages import TYPED
from smart_tire.messages.describe import NODE_TABLE, TOPIC_NAMES
from support.policies import rules_in

FILE = Path(__file__).resolve().parents[2] / 'config' / 'security' / 'policy.xml'
pytestmark = pytest.mark.processes

RULES = rules_in(policy())
PUBLISHERS = {
    '/cmd_vel': {'trajectory_controller', OPERATOR}, '/path': {OPERATOR}, '/goal_pose': {OPERATOR},
    '/motor_commands': {'wheel_controller'}, '/wheel_states': {'motor_driver'},
    '/emergency_stop_active': {'motor_driver'}, '/motors_enabled': {'motor_driver'},
    '/imu/data': {'imu_driver'}, '/odom': {'slip_estimator'},
    '/tf': {'slip_estimator', 'robot_state_publisher', 'amcl', 'ekf_filter_node'},
    '/tf_static': {'slip_estimator', 'robot_state_publisher'}}
# What nodes of other packages use, from their sources on Jazzy: publish, subscribe, serve.
USED = {
    'robot_state_publisher': (
        {'/robot_description', '/tf', '/tf_static'}, {'/wheel_states'}, set()),
    'amcl': (
        {'/amcl_pose', '/particle_cloud', '/tf', '/bond', '/amcl/transition_event'},
        {'/scan', '/map', '/initialpose', '/tf', '/tf_static', '/bond'},
        {'/reinitialize_global_localization', '/set_initial_pose', '/request_nomotion_update',
         '/amcl/change_state', '/amcl/get_state', '/amcl/get_available_states',
         '/amcl/get_available_transitions', '/amcl/get_transition_graph'}),
    'ekf_filter_node': (
        {'/odometry/filtered', '/accel/filtered', '/tf'},
        {'/odom', '/imu/data', '/set_pose', '/tf', '/tf_static'},
        {'/set_pose', '/enable', '/reset', '/toggle'})}


COMMON = {'/rosout', '/parameter_events', '/diagnostics', '/clock', '/_replay_lockstep'}


def allowed(kind: str, role: str, name: str) -> set[str]:
    """Return the enclaves that may do something."""
    return {node for node, rules in RULES.items() if name in rules[kind, role]}


def test_the_file_is_current():
    assert FILE.read_text(encoding='utf-8') == policy()


def test_every_node_may_do_what_the_table_says_and_no_more():
    for node in NODE_TABLE.values():
        rules = RULES[node.name]
        common = {'/rosout', '/parameter_events', '/diagnostics'}
        replayed = {'/_replay_lockstep'} if 'estimator' in node.name else set()
        typed = {TYPED[name].name for name in node.publishes if name in TYPED}
        assert rules['topics', 'publish'] == common | replayed | {
            f'/{name.lstrip("/")}' for name in (*node.publishes, *typed)}
        # speed_limit of nav2 is of a type that is not always installed
        replayed |= {'/speed_limit'} if node.name == 'trajectory_controller' else set()
        assert rules['topics', 'subscribe'] - {'/clock', '/parameter_events'} == replayed | {
            f'/{name.lstrip("/")}' for name in node.subscribes}
        assert not rules['services', 'request'] | rules['actions', 'call']


@pytest.mark.parametrize('topic', PUBLISHERS)
def test_only_these_may_publish_what_moves_the_robot(topic):
    assert allowed('topics', 'publish', topic) == PUBLISHERS[topic]


@pytest.mark.parametrize('node', USED)
def test_a_node_of_another_package_may_do_what_it_needs_and_no_more(node):
    assert USED.keys() == FOREIGN.keys()
    rules, (publish, subscribe, serve) = RULES[node], USED[node]
    assert rules['topics', 'publish'] - {'/rosout', '/parameter_events', '/diagnostics'} == publish
    assert rules['topics', 'subscribe'] - {'/clock', '/parameter_events'} == subscribe
    assert {name for name in rules['services', 'reply'] if 'parameter' not in name} - {
        f'/{node}/get_type_description'} == serve
    assert not rules['services', 'request'] | rules['actions', 'call']
    for name in (OPERATOR, OBSERVER):
        assert publish | subscribe <= RULES[name]['topics', 'subscribe']


def test_only_an_operator_calls_services_that_change_something():
    for node in (*NODE_TABLE.values(), *FOREIGN.values()):
        names = [service.name for service in node.services]
        changing = [*names, f'{node.name}/set_parameters',
                    f'{node.name}/set_parameters_atomically']
        for name in changing:
            kind, role = (('actions', 'call') if name == 'follow_path'
                          else ('services', 'request'))
            assert allowed(kind, role, f'/{name}') == {OPERATOR}


def test_an_observer_sees_everything_and_changes_nothing():
    rules = RULES[OBSERVER]
    assert {f'/{name.lstrip("/")}' for name in TOPIC_NAMES} <= rules['topics', 'subscribe']
    assert rules['topics', 'publish'] == {'/rosout', '/parameter_events', '/diagnostics'}
    assert not any('set' in name for name in rules['services', 'request'])


def test_the_names_of_a_robot_in_a_namespace_are_in_it():
    named, plain = rules_in(policy('a/r1')), rules_in(policy())
    assert named.keys() == plain.keys()
    for node, rules in named.items():
        for kind, names in rules.items():
            assert names == {name if name in COMMON else f'/a/r1{name}'
                             for name in plain[node][kind]}, (node, kind)


def test_each_program_has_an_enclave_in_the_namespace():
    enclaves = [element.get('path') for element in
                ElementTree.fromstring(policy('a/r1').encode()).iter('enclave')]
    assert sorted(enclaves) == sorted(
        f'/a/r1/{name}' for name in (*NODE_TABLE, *USED, 'composed', OPERATOR, OBSERVER))


@pytest.mark.parametrize('namespace', ['', 'r1', '/a/r1/'])
def test_the_command_prints_the_policy(namespace, capsys):
    assert main(['policy', *filter(None, [namespace])]) == 0
    assert capsys.readouterr().out == policy(namespace.strip('/'))


@pytest.mark.parametrize('namespace', ['r 1', '1r', 'a//b', '<r1>'])
def test_a_namespace_that_ros_does_not_allow_is_a_usage_error(namespace, capsys):
    assert main(['policy', namespace]) == 2
    out, err = capsys.readouterr()
    assert (out, err) == ('', f'smart_tire policy: {namespace}: no namespace of ROS\n')


CREATE_PUBLISHER = """
import rclpy
from geometry_msgs.msg import TwistStamped
rclpy.init(args=['--ros-args', '--enclave', '/{enclave}'])
rclpy.create_node('{enclave}').create_publisher(TwistStamped, '/cmd_vel', 1)
"""


@pytest.mark.skipif(find_spec('sros2') is None, reason='needs a ROS distribution: SROS2')
def test_sros2_enforces_the_policy(tmp_path, isolated_ros):
    keystore = tmp_path / 'keystore'

    def sros2(verb, *words):
        subprocess.run(['ros2', 'security', verb, keystore, *words], check=True)

    sros2('create_keystore')
    for node in RULES:
        sros2('create_enclave', f'/{node}')
        sros2('create_permission', f'/{node}', FILE)
        made = (keystore / 'enclaves' / node / 'permissions.xml').read_text(encoding='utf-8')
        assert ('<topic>rt/motor_commands</topic>' in made) == (
            node in {'wheel_controller', 'motor_driver', OPERATOR, OBSERVER})
    for node, is_allowed in ((OPERATOR, True), (OBSERVER, False)):
        tried = subprocess.run(
            [sys.executable, '-c', CREATE_PUBLISHER.format(enclave=node)], text=True,
            capture_output=True, env={
                **os.environ, 'ROS_SECURITY_ENABLE': 'true', 'ROS_SECURITY_STRATEGY': 'Enforce',
                'ROS_SECURITY_KEYSTORE': str(keystore)})
        if 'security libraries' in tried.stderr:
            pytest.skip('needs a middleware with security')
        assert (tried.returncode == 0) == is_allowed, tried.stderr
