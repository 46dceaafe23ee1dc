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
Writes the SROS2 policy of a robot: what each node may publish, subscribe to, serve and call.

``python docs/security_policy.py FILE [NAMESPACE]`` writes it to FILE; a test checks that
``config/security/policy.xml`` is current. docs/how_to/security.md has the steps from it to a
keystore.
"""

from __future__ import annotations

from collections.abc import Iterable
from copy import deepcopy
from pathlib import Path
import sys
from xml.etree import ElementTree

from smart_tire.messages import TYPED
from smart_tire.messages.describe import (
    DIAGNOSTICS, FROM_USER, NODE_TABLE, Service, TOPIC_NAMES)
from smart_tire.nodes.command_line import COMPOSED, COMPOSED_NODES

HEADER = """<?xml version="1.0" encoding="UTF-8"?>
<!-- SROS2 policy: an enclave for each node, for operators and for observers.
     "make config" writes this file; docs/how_to/security.md explains it. -->
"""
# Of every node: log, time and parameters, as in the policies of SROS2.
COMMON_TOPICS = {'publish': ('/rosout', '/parameter_events', DIAGNOSTICS),
                 'subscribe': ('/clock', '/parameter_events')}
PARAMETER_SERVICES = tuple(f'~/{name}' for name in (
    'describe_parameters', 'get_parameter_types', 'get_parameters', 'list_parameters',
    'set_parameters', 'set_parameters_atomically', 'get_type_description'))
READING = ('describe_parameters', 'get_parameters', 'list_parameters')
REPLAYED = {'slip_estimator': ['/_replay_lockstep'], 'friction_estimator': ['/_replay_lockstep']}
TRANSFORMS = ('/tf', '/tf_static')
OPERATOR, OBSERVER = 'operator', 'observer'  # drive, teleoperation, navigation; record, view


def policy(namespace: str = '') -> str:
    """Return the policy of a robot whose nodes are in ``namespace``."""
    root = ElementTree.Element('policy', version='0.2.0')
    enclaves = ElementTree.SubElement(root, 'enclaves')
    for node in NODE_TABLE.values():
        replayed = REPLAYED.get(node.name, [])
        _enclave(enclaves, namespace, node.name,
                 [*node.publishes, *replayed, *(
                     TYPED[name].name for name in node.publishes if name in TYPED)],
                 [*node.subscribes, *replayed],
                 reply=[one.name for one in node.services if not _is_action(one)],
                 execute=[one.name for one in node.services if _is_action(one)])
    _composed_enclave(enclaves, namespace)
    offered = [one for node in NODE_TABLE.values() for one in node.services]
    reading = [f'{node}/{service}' for node in NODE_TABLE for service in READING]
    setting = [f'{node}/{name}' for node in NODE_TABLE
               for name in ('set_parameters', 'set_parameters_atomically')]
    _enclave(enclaves, namespace, OPERATOR, FROM_USER, TOPIC_NAMES,
             request=[*(one.name for one in offered if not _is_action(one)), *reading, *setting],
             call=[one.name for one in offered if _is_action(one)])
    _enclave(enclaves, namespace, OBSERVER, (), TOPIC_NAMES, request=reading)
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


if __name__ == '__main__':
    Path(sys.argv[1]).write_text(policy(*sys.argv[2:]), encoding='utf-8')
