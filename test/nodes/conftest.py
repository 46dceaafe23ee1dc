# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Tests of nodes are skipped if rclpy is not installed."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

if find_spec('rclpy') is None:
    collect_ignore_glob = ['test_*.py']


@pytest.fixture
def graph(tmp_path: Path, isolated_ros: None) -> Iterator[Any]:
    """Return the node of the test in the ROS graph, which can start other nodes."""
    from support.graph import Graph

    with Graph(tmp_path) as made:
        yield made
