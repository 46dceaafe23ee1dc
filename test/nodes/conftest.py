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
