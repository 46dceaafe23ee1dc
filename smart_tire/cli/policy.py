# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
``smart_tire policy``: the SROS2 policy of a robot, with an enclave for each program.

An enclave allows what its program publishes, subscribes to, serves and calls; all else is denied.
docs/how_to/security.md has the steps from the policy to a keystore.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from copy import deepcopy
from xml.etree import ElementTree

from smart_tire.errors import ParameterError
from smart_tire.launching import PUBLISHER, topic
from smart_tire.messages import TYPED
from smart_tire.messages.describe import (
    DIAGNOSTICS, FROM_USER, NODE_TABLE, NodeEntry, Service, TOPIC_NAMES)
from smart_tire.nodes.command_line import COMPOSED, COMPOSED_NODES

HEADER = """<?xml version="1.0" encoding="UTF-8"?>
<!-- SROS2 policy: an enclave for each node, for operators and for observers; written by
     "smart_tire policy". docs/how_to/security.md explains it. -->
"""
# Of every node: log, time and parameters, as in the policies of SROS2.
COMMON_TOPICS = {'publish': ('/rosout', '/parameter_events', DIAGNOSTICS),
                 'subscribe': ('/clock', '/parameter_events')}
PARAMETER_SERVICES = tuple(f'~/{name}' for name in (
    'describe_parameters', 'get_parameter_types', 'get_parameters', 'list_parameters',
    'set_parameters', 'set_parameters_atomically', 'get_type_description'))
READING = ('describe_parameters', 'get_parameters', 'list_parameters')
REPLAYED = {'slip_estimator': ['/_replay_lockstep'], 'friction_estimator': ['/_replay_lockstep']}
NAV2 = {'trajectory_controller': ['speed_limit']}  # of types that are not always installed
TRANSFORMS = ('/tf', '/tf_static')
LIFECYCLE = ('change_state', 'get_state', 'get_available_states', 'get_available_transitions',
             'get_transition_graph')
OPERATOR, OBSERVER = 'operator', 'observer'  # drive, teleoperation, RViz; record, view


def _services(*names: str) -> tuple[Service, ...]:
    return tuple(Service(name, '', '') for name in names)


# Nodes of other packages with their default names, on Jazzy: robot_state_publisher, nav2_amcl and
# ekf_node of robot_localization as in docs/how_to/robot_localization.md.
FOREIGN = {node.name: node for node in (
    NodeEntry(PUBLISHER, '', ('wheel_states',), ('robot_description', *TRANSFORMS)),
    NodeEntry('amcl', '', ('scan', 'map', 'initialpose', 'bond', *TRANSFORMS),
              ('amcl_pose', 'particle_cloud', 'bond', '~/transition_event', '/tf'),
              _services('reinitialize_global_localization', 'request_nomotion_update',
                        'set_initial_pose', *(f'amcl/{name}' for name in LIFECYCLE))),
    NodeEntry('ekf_filter_node', '', ('odom', 'imu/data', 'set_pose', *TRANSFORMS),
              ('odometry/filtered', 'accel/filtered', '/tf'),
              _services('set_pose', 'enable', 'reset', 'toggle')))}
FROM_OPERATOR = (*FROM_USER, 'initialpose', 'set_pose')


def run(args: argparse.Namespace) -> int:
    """Print the policy."""
    space = args.namespace.strip('/')
    try:
        print(policy(topic(space) if space else ''), end='')
    except ValueError as error:
        raise ParameterError(f'{args.namespace}: no namespace of ROS') from error
    return 0


def policy(namespace: str = '') -> str:
    """Return the policy of a robot whose nodes are in ``namespace``, '' or without outer ``/``."""
    root = ElementTree.Element('policy', version='0.2.0')
    enclaves = ElementTree.SubElement(root, 'enclaves')
    nodes = {**NODE_TABLE, **FOREIGN}
    for node in nodes.values():
        replayed = REPLAYED.get(node.name, [])
        _enclave(enclaves, namespace, node.name,
                 [*node.publishes, *replayed, *(
                     TYPED[name].name for name in node.publishes if name in TYPED)],
                 [*node.subscribes, *replayed, *NAV2.get(node.name, [])],
                 reply=[one.name for one in node.services if not _is_action(one)],
                 execute=[one.name for one in node.services if _is_action(one)])
    _composed_enclave(enclaves, namespace)
    offered = [one for node in nodes.values() for one in node.services]
    reading = [f'{node}/{service}' for node in nodes for service in READING]
    setting = [f'{node}/{name}' for node in nodes
               for name in ('set_parameters', 'set_parameters_atomically')]
    visible = [*TOPIC_NAMES, *(name.replace('~', node.name) for node in FOREIGN.values()
                               for name in (*node.publishes, *node.subscribes))]
    _enclave(enclaves, namespace, OPERATOR, FROM_OPERATOR, visible,
             request=[*(one.name for one in offered if not _is_action(one)), *reading, *setting],
             call=[one.name for one in offered if _is_action(one)])
    _enclave(enclaves, namespace, OBSERVER, (), visible, request=reading)
    ElementTree.indent(root)
    return HEADER + ElementTree.tostring(root, encoding='unicode') + '\n'


def _composed_enclave(enclaves: ElementTree.Element, namespace: str) -> None:
    """Append the enclave of the process ``composed``: what its nodes may, under their names."""
    profiles = [deepcopy(profile) for profile in enclaves.iter('profile')
                if profile.get('node') in COMPOSED_NODES]
    place = ElementTree.SubElement(enclaves, 'enclave', path=_path(namespace, COMPOSED))
    ElementTree.SubElement(place, 'profiles').extend(profiles)


def _path(namespace: str, name: str) -> str:
    return '/'.join(('', *filter(None, (namespace, name))))


def _is_action(service: Service) -> bool:
    return '/action/' in service.type


def _enclave(parent: ElementTree.Element, namespace: str, node: str, publish: Iterable[str],
             subscribe: Iterable[str], *, reply: Iterable[str] = (), request: Iterable[str] = (),
             execute: Iterable[str] = (), call: Iterable[str] = ()) -> None:
    """Append an enclave whose profile allows what is listed, and what every node needs."""
    place = ElementTree.SubElement(parent, 'enclave', path=_path(namespace, node))
    profile = ElementTree.SubElement(
        ElementTree.SubElement(place, 'profiles'), 'profile', ns=f'/{namespace}', node=node)
    for kind, role, names in (
            ('topic', 'publish', (*COMMON_TOPICS['publish'], *publish)),
            ('topic', 'subscribe', (*COMMON_TOPICS['subscribe'], *subscribe)),
            ('service', 'reply', (*PARAMETER_SERVICES, *reply)), ('service', 'request', request),
            ('action', 'execute', execute), ('action', 'call', call)):
        if listed := dict.fromkeys(names):
            rule = ElementTree.SubElement(profile, f'{kind}s', {role: 'ALLOW'})
            for name in listed:
                # in a namespace, the launch files remap /tf as nav2 does
                ElementTree.SubElement(rule, kind).text = (
                    name.lstrip('/') if namespace and name in TRANSFORMS else name)
