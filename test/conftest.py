"""
What tests share: a ROS domain, ports to plug in, and the order in which two workers take them.

A worker takes all tests of a file, so that what they share is made once. Tests that start nodes
or wait for devices are two groups, each for one worker, one test after the other: those of the
wheels' safety, which mostly wait, and all others. Then both workers compute. Groups of xdist
itself are no help: with this pytest it does not see them.
"""

from __future__ import annotations

from collections.abc import Iterator
import fcntl
import os
from pathlib import Path
import signal
import tempfile
from typing import Any, IO

from hypothesis import HealthCheck, settings
import pytest
from support.machine import beside_others
from support.pty_port import PtyPort

# Matrices are small: threads would only wait for each other, and for the other worker's.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

# How long an example takes is a matter of what else runs; what fails must fail again.
settings.register_profile('anywhere', deadline=None, derandomize=True,
                          suppress_health_check=[HealthCheck.too_slow])
settings.load_profile('anywhere')

WITH_PROCESSES = (
    'test/integration/', 'test/safety/', 'test/nodes/', 'test/drivers/', 'test/cli/test_record.py',
    'test/cli/test_replay.py', 'test/cli/test_processes.py', 'test/simulation/test_realtime.py',
    'test/test_launch.py')
OF_THE_WHEELS = ('test/safety/', 'test/drivers/')  # mostly waiting: a group of their own
LONG = (  # ten seconds and more
    'test/analysis/test_offline.py', 'test/analysis/test_recordings.py',
    'test/estimation/slip/test_consistency.py', 'test/estimation/slip/test_estimator.py',
    'test/estimation/friction/test_estimator.py', 'test/analysis/test_smoothing.py',
    'test/reproduction/test_tire_reports.py', 'test/cli/test_reproduce.py',
    'test/estimation/film/test_measure.py', 'test/estimation/friction/test_waveform_fit.py',
    'test/calibration/tire/test_stiffness.py', 'test/numerics/test_delay_regression.py',
    'test/calibration/robot/test_wheel_latency.py')

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


def _turn(file: str) -> int:
    """Return the place of a file of tests among those that come first, the same for all others."""
    firsts = (*WITH_PROCESSES, *LONG)
    return next((turn for turn, name in enumerate(firsts) if name in file), len(firsts))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put those tests first that take longest."""
    turns = {path: _turn(path.as_posix()) for path in {item.path for item in items}}
    items.sort(key=lambda item: turns[item.path])


@pytest.hookimpl(optionalhook=True)  # of xdist, where it is installed
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Return who shares out the files among the workers."""
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = super()._split_scope(nodeid)
            if any(name in file for name in OF_THE_WHEELS):
                return 'of the wheels'
            return 'with processes' if _turn(file) < len(WITH_PROCESSES) else file

    config.option.loadscopereorder = False  # they are in order
    return Scheduling(config, log)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Leave the machine to those who need all of it."""
    if _turn(item.path.as_posix()) < len(WITH_PROCESSES):
        return (yield)  # they come one after the other, and some ask for it
    with beside_others():
        return (yield)


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
