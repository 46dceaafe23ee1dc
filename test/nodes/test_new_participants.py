# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A node while other participants appear: it waits for a core at most, not for a lock."""

from __future__ import annotations

from contextlib import ExitStack
import textwrap
import time

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from smart_tire.host_load import CoreWait, SCHEDSTAT
from std_msgs.msg import Int64
from support.command import Python
from support.waiting import wait_for

pytestmark = [pytest.mark.processes, pytest.mark.long]

PARTICIPANTS, TOPICS = 6, 40
PERIOD = 0.01      # s
MAX_BLOCKED = 0.1  # s; a stall of 0.2 to 0.4 s stops the wheels
STRANGER = textwrap.dedent(f"""
    import sys
    import rclpy
    from std_msgs.msg import Int64
    rclpy.init()
    node = rclpy.create_node('stranger' + sys.argv[1])
    publishers = [node.create_publisher(Int64, f'topic{{number}}', 10)
                  for number in range({TOPICS})]
    print('ready', flush=True)
    rclpy.spin(node)
    """)


@pytest.mark.skipif(not SCHEDSTAT.exists(), reason='the kernel counts no waiting')
def test_new_participants_hold_up_a_node_by_its_waiting_for_a_core_only():
    blocked, waited_for_core = [], CoreWait()

    def spin():
        begin, waited = time.monotonic(), waited_for_core()
        publisher.publish(Int64())
        executor.spin_once(timeout_sec=PERIOD)
        blocked.append(time.monotonic() - begin - (waited_for_core() - waited) - PERIOD)

    rclpy.init(args=[])
    with ExitStack() as stack:
        stack.callback(rclpy.try_shutdown)
        node, executor = rclpy.create_node('test'), SingleThreadedExecutor()
        executor.add_node(node)
        publisher = node.create_publisher(Int64, 'own', 10)
        for number in range(10):
            node.create_subscription(Int64, f'topic{number}', lambda msg: None, 10)
        spin()
        del blocked[:]  # the first call imports
        for number in range(PARTICIPANTS):
            stack.enter_context(Python('-c', STRANGER, str(number)))
        wait_for(lambda: node.count_publishers(f'topic{TOPICS - 1}') == PARTICIPANTS, spin)
        node.destroy_node()
    assert max(blocked) < MAX_BLOCKED
