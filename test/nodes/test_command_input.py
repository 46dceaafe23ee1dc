# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Publishers of orders, by node: one that has ended is none, one not discovered yet is one."""

from types import SimpleNamespace

import pytest
from smart_tire.nodes.command_input import PublisherCheck
from smart_tire.nodes.compat import UNDISCOVERED, UNKNOWN_NODE

FIRST, SECOND = b'1', b'2'  # identifiers of publishers


@pytest.mark.parametrize(('existing', 'named'), [
    ({FIRST: 'test', SECOND: 'stranger'}, '/stranger, /test'),
    ({FIRST: 'test', SECOND: UNKNOWN_NODE}, f'/test, {UNDISCOVERED}'),
    ({FIRST: 'test'}, f'/test, {UNDISCOVERED}'),  # a message can precede its discovery
    ({FIRST: 'test', SECOND: 'test'}, ''),
    ({SECOND: 'stranger'}, ''),  # as one order of ``ros2 topic pub --once`` after another
])
def test_a_second_node_that_sends_is_a_conflict_even_before_it_is_discovered(existing, named):
    node = SimpleNamespace(get_publishers_info_by_topic=lambda _: [
        SimpleNamespace(endpoint_gid=gid, node_name=name, node_namespace='/')
        for gid, name in existing.items()])
    check = PublisherCheck(node, 'path', window=1.0)
    texts = [check.record(check.sender({'publisher_gid': {'data': gid}}), now_ns, by_node=True)
             for now_ns, gid in enumerate((FIRST, SECOND))]
    assert texts == ['', named and f'2 publishers on path: {named}']
