"""Safety tests run real nodes; they are skipped if rclpy is not installed."""

from __future__ import annotations

from importlib.util import find_spec

if find_spec('rclpy') is None:
    collect_ignore_glob = ['test_*.py']
