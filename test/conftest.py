"""What the tests with ROS share: a domain of their own, a graph to look at, ports to plug in."""

from __future__ import annotations

from collections.abc import Iterator
import fcntl
import os
from pathlib import Path
import tempfile
from typing import IO

import pytest
from support.pty_port import PtyPort

DOMAINS = range(1, 102)  # above, DDS ports meet those that the system hands out


def _take_domain() -> tuple[int, IO[str]]:
    """Return a domain that no other test process on this machine uses, and its lock."""
    for domain in DOMAINS:
        lock = (Path(tempfile.gettempdir()) / f'smart_tire_test_domain_{domain}').open('a')
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            lock.close()
        else:
            return domain, lock
    raise RuntimeError('all domains are in use by other tests')


@pytest.fixture(scope='session', autouse=True)
def isolated_ros() -> Iterator[None]:
    """Keep what the tests say on DDS to themselves and their children."""
    domain, lock = _take_domain()
    with lock, pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_DOMAIN_ID', str(domain))
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        patch.setenv('PYTHONPATH', os.pathsep.join(
            [str(Path(__file__).resolve().parents[1]), os.environ.get('PYTHONPATH', '')]))
        # Set inside a Python that has the rclpy wheels; a child must find its own libraries.
        patch.delenv('_ROS_WHEELS_BOOTSTRAP_COMPLETE', raising=False)
        yield


@pytest.fixture
def port(tmp_path: Path) -> Iterator[PtyPort]:
    """Return a serial port that is not plugged in yet."""
    device = PtyPort(tmp_path / 'device')
    yield device
    device.unplug()
