"""
What tests share: a ROS domain, ports to plug in, and the order in which two workers take them.

A worker takes all tests of a file, so that what they share is made once. Tests that start nodes or
wait for devices all go to one worker, one after the other, while the other one computes.
"""

from __future__ import annotations

from collections.abc import Iterator
import fcntl
import os
from pathlib import Path
import signal
import tempfile
from typing import IO

import pytest
from support.pty_port import PtyPort

# Matrices are small: threads would only wait for each other, and for the other worker's.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

TESTS = Path(__file__).parent
WITH_PROCESSES = (
    'integration', 'nodes', 'links', 'cli/test_record.py', 'cli/test_replay.py',
    'cli/test_stack.py', 'simulation/test_hardware.py')
LONG = ()

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


@pytest.hookimpl(tryfirst=True)  # before xdist reads the groups
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Say which tests go to one worker, and put those first that take longest."""
    turns = {path: _turn(path.relative_to(TESTS)) for path in {item.path for item in items}}
    items.sort(key=lambda item: turns[item.path])
    for item in items:
        together = turns[item.path] < len(WITH_PROCESSES)
        item.add_marker(pytest.mark.xdist_group('processes' if together else str(item.path)))


def _turn(file: Path) -> int:
    """Return the place of a file among those that come first, the same for all others."""
    firsts, names = (*WITH_PROCESSES, *LONG), {str(file), *map(str, file.parents)}
    return next((turn for turn, name in enumerate(firsts) if name in names), len(firsts))


@pytest.fixture(scope='session', autouse=True)
def isolated_ros() -> Iterator[None]:
    """Keep what the tests say on DDS to themselves and their children, which heed signals."""
    domain, lock = _take_domain()
    with lock, pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_DOMAIN_ID', str(domain))
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        patch.setenv('PYTHONPATH', os.pathsep.join(
            [str(Path(__file__).resolve().parents[1]), os.environ.get('PYTHONPATH', '')]))
        # Set inside a Python that has the rclpy wheels; a child must find its own libraries.
        patch.delenv('_ROS_WHEELS_BOOTSTRAP_COMPLETE', raising=False)
        if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
            # Shells have programs in the background ignore it, and children inherit that.
            signal.signal(signal.SIGINT, signal.default_int_handler)
        yield


@pytest.fixture
def port(tmp_path: Path) -> Iterator[PtyPort]:
    """Return a serial port that is not plugged in yet."""
    device = PtyPort(tmp_path / 'device')
    yield device
    device.unplug()
