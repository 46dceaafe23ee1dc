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

import pytest
from smart_tire.control.publishers import MessageInfo, PublisherCheck, UNDISCOVERED
from smart_tire.samples import NS_PER_S

FIRST, SECOND = b'1', b'2'  # identifiers of publishers


@pytest.mark.parametrize(('existing', 'named'), [
    ({FIRST: '/test', SECOND: '/stranger'}, '/stranger, /test'),
    ({FIRST: '/test', SECOND: UNDISCOVERED}, f'/test, {UNDISCOVERED}'),
    ({FIRST: '/test'}, f'/test, {UNDISCOVERED}'),  # a message can precede its discovery
    ({FIRST: '/test', SECOND: '/test'}, ''),
    ({SECOND: '/stranger'}, ''),  # as one order of ``ros2 topic pub --once`` after another
])
def test_a_second_node_that_sends_is_a_conflict_even_before_it_is_discovered(existing, named):
    check = PublisherCheck('path', 1.0, lambda: existing)
    texts = [check.record(check.sender(MessageInfo(0, 0, 7, gid)), now_ns, by_node=True)
             for now_ns, gid in enumerate((FIRST, SECOND))]
    assert texts == ['', named and f'2 publishers on path: {named}']


@pytest.mark.parametrize('by_node', [False, True])
def test_all_that_exist_are_senders_of_a_message_of_which_nothing_is_known(by_node):
    existing = {FIRST: '/test'}
    check = PublisherCheck('path', 1.0, lambda: existing)

    def record(now_ns):
        return check.record(check.sender(MessageInfo(0, 0)), now_ns, by_node=by_node)

    assert record(0) == ''
    existing[SECOND] = '/stranger'
    assert record(1) == '2 publishers on path: /stranger, /test'
    del existing[SECOND]
    assert bool(record(NS_PER_S)) is not by_node  # the other one may have sent before
    assert check.conflicting(NS_PER_S + 1)
    assert record(NS_PER_S + 2) == ''
