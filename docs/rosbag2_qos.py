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
Writes the queues of this package as a file for ``ros2 bag record``.

``python docs/rosbag2_qos.py FILE`` writes it; a test checks that ``config/rosbag2_qos.yaml`` is
current.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
import sys

from smart_tire.messages import ALL_TOPICS
from smart_tire.nodes.qos import LATCHED, OTHER_DEPTH, subscriber_qos
from smart_tire.samples import WHEELS

HEADER = (
    '# For "ros2 bag record --qos-profile-overrides-path FILE": queues deep enough to lose no',
    '# message while the disk is busy; the default of rosbag2 is 10 messages per topic.',
    '# For a robot in a namespace, prefix each topic with it. For a publisher that offers best',
    '# effort only, change the reliability: a reliable subscription does not connect to it.',
    '# The depths are those of smart_tire/nodes/qos.py; "make config" writes this file.')


def rosbag2_overrides() -> str:
    """
    Return the file for ``ros2 bag record --qos-profile-overrides-path``.

    Transient-local topics are left out: rosbag2 adapts to their durability itself.
    """
    return '\n'.join((*HEADER, *_overrides())) + '\n'


def _overrides() -> Iterator[str]:
    for name in (*(name for name in ALL_TOPICS if name not in LATCHED), 'tf', 'diagnostics'):
        profile = subscriber_qos(name, wheels=len(WHEELS))
        yield from (
            f'/{name}:', '  history: keep_last', f'  depth: {max(profile.depth, OTHER_DEPTH)}',
            f'  reliability: {profile.reliability.short_key}',
            f'  durability: {profile.durability.short_key}')


if __name__ == '__main__':
    Path(sys.argv[1]).write_text(rosbag2_overrides(), encoding='utf-8')
