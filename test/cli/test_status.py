# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What status and doctor show of a running node, and status without one."""

from __future__ import annotations

from importlib.util import find_spec
import json

import pytest

from smart_tire.cli import _live_checks
from smart_tire.cli._live_checks import Heard
from smart_tire.cli.main import main

pytestmark = [pytest.mark.processes, pytest.mark.skipif(
    find_spec('rclpy') is None, reason='rclpy is not installed')]


def test_a_running_node_is_shown_by_status_and_doctor(tmp_path, isolated_ros, capfd, monkeypatch):
    from support.graph import Graph
    monkeypatch.setattr(_live_checks, 'DISCOVERY_TIME', 0.2)
    heard, findings, statuses = Heard(), [], []
    with Graph(tmp_path) as graph, graph.start('slip_estimator'):
        graph.until(lambda: 'slip_estimator' in graph.health)
        capfd.readouterr()
        graph.until(lambda: 1 in statuses,  # discovery may take several attempts
                    lambda: statuses.append(main(['status', '--json', '--seconds', '1.2'])))
        out = capfd.readouterr().out
        graph.until(lambda: 'slip_estimator' in heard.statuses
                    and '/slip_estimator' in heard.nodes,
                    lambda: findings.append(list(_live_checks._listen(1.2, heard))))
    tree = json.loads(out[out.rindex('{\n  "exit_status"'):])
    names = {row['name']: row['level'] for robot in tree['robots'] for row in robot['nodes']}
    assert names['slip_estimator'] == 'warning' and tree['exit_status'] == 1
    assert '/slip_estimator' in heard.nodes and '/slip_estimator' in findings[-1][-1].text
    assert 'no imu/data' in heard.statuses['slip_estimator'].message


def test_status_without_nodes_has_exit_status_2(isolated_ros, capfd):
    assert main(['status', '--once', '--seconds', '0.3']) == 2
    assert 'no node of smart_tire is heard' in capfd.readouterr().out.replace('\n', ' ')
