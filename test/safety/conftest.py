"""The wheels' safety needs real nodes; where rclpy is missing, its tests are left out."""

from __future__ import annotations

from importlib.util import find_spec

if find_spec('rclpy') is None:
    collect_ignore_glob = ['test_*.py']
