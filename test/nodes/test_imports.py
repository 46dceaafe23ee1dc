# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Nodes start without libraries that they use later, or never."""

import signal

import pytest
from smart_tire.parameters import NODE_PARAMS
from support.graph import Process

pytestmark = pytest.mark.processes

SLOW = ('argcomplete', 'cv2', 'lz4', 'matplotlib', 'mcap', 'pandas', 'plotly', 'rich',
        'rosbags', 'scipy', 'zstandard')
CODE = f"""import sys
from smart_tire.nodes.{{name}} import main
status = main()
print('imported:', [name for name in {SLOW} if name in sys.modules])
sys.exit(status)
"""


@pytest.mark.parametrize('name', NODE_PARAMS)
def test_a_node_starts_without_slow_imports(name, graph, tmp_path):
    ports = [word for port in ('tire_radio', 'imu', 'motors')
             for word in ('-p', f'ports.{port}:={tmp_path / port}')
             if name == 'robot_simulator']
    with Process(['-c', CODE.format(name=name), '--ros-args', *ports],
                 tmp_path / 'output.log') as node:
        graph.until(lambda: name in graph.health)
        assert node.end(signal.SIGINT) == 0
        assert node.output.splitlines()[-1] == 'imported: []'
