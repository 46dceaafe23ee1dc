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
What tests share: a ROS domain, serial ports, and the order in which workers run the tests.

With pytest-xdist, a worker runs all tests of a file, so that its fixtures are made once. Modules
marked ``processes`` and ``safety``, which mostly wait, come first, then those marked ``slow``,
then all others. ``pyproject.toml`` declares the markers.
"""

from __future__ import annotations

from collections.abc import Iterator
import fcntl
import gc
import os
from pathlib import Path
import signal
import tempfile
from typing import Any, IO

from benchmarks.events import FOLDER_VARIABLE
from hypothesis import HealthCheck, Phase, settings
import pytest
from support.groups import GROUPS
from support.pty_port import PtyPort
from support.skipped import pytest_sessionfinish  # noqa: F401 - a hook

# Matrices are small: threads would only compete with each other and with the other worker.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

# Samples and syntax trees are many and without cycles: a fourth of the time to collect the tests.
gc.set_threshold(100_000)

# Durations depend on the load of the machine; a failure must be reproducible.
settings.register_profile('anywhere', deadline=None, derandomize=True,
                          suppress_health_check=[HealthCheck.too_slow])
# A mutant needs no small example.
settings.register_profile('mutant', settings.get_profile('anywhere'),
                          phases=(Phase.explicit, Phase.generate))
settings.load_profile('mutant' if 'MUTANT_TREE' in os.environ else 'anywhere')

ORDER = (*GROUPS, 'slow')  # markers of the tests that come first

DOMAINS = range(1, 102)  # above, DDS ports overlap the ephemeral ports


def _take_domain() -> tuple[int, IO[str]]:
    """Return a ROS domain that no other test process on this machine uses, and its lock."""
    for domain in DOMAINS:
        lock = (Path(tempfile.gettempdir()) / f'smart_tire_test_domain_{domain}').open('a')
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            lock.close()
        else:
            return domain, lock
    raise RuntimeError('all domains are in use by other tests')


def _rank(item: pytest.Item) -> int:
    """Return the position in ``ORDER`` of the first marker of ``item``, or its length."""
    return next((rank for rank, name in enumerate(ORDER) if item.get_closest_marker(name)),
                len(ORDER))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put those tests first that take longest; samples and syntax trees are no garbage."""
    if 'PYTEST_XDIST_WORKER' in os.environ:  # else the order of the command line
        items.sort(key=_rank)
    gc.freeze()


@pytest.hookimpl(optionalhook=True)  # of xdist, where it is installed
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Return the scheduler that assigns files to workers, in their order."""
    from xdist.scheduler import LoadFileScheduling

    config.option.loadscopereorder = False
    return LoadFileScheduling(config, log)


@pytest.fixture(scope='session', autouse=True)
def isolated_ros() -> Iterator[None]:
    """Isolate the tests and their child processes on DDS; children react to signals."""
    domain, lock = _take_domain()
    with lock, pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_DOMAIN_ID', str(domain))
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        patch.setenv('PYTHONPATH', os.pathsep.join(
            [str(Path(__file__).resolve().parents[1]), os.environ.get('PYTHONPATH', '')]))
        # Set inside a Python that has the rclpy wheels; a child must find its own libraries.
        patch.delenv('_ROS_WHEELS_BOOTSTRAP_COMPLETE', raising=False)
        if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
            # A shell ignores it for programs in the background, and children inherit that.
            signal.signal(signal.SIGINT, signal.default_int_handler)
        yield


@pytest.fixture(scope='session', autouse=True)
def shared_events(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Let all workers share the events of the scenarios: each is simulated once."""
    folder = tmp_path_factory.getbasetemp()
    if 'PYTEST_XDIST_WORKER' in os.environ:
        folder = folder.parent  # of all workers of this run
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FOLDER_VARIABLE, str(folder / 'events'))
        yield


@pytest.fixture
def port(tmp_path: Path) -> Iterator[PtyPort]:
    """Return a serial port that is not plugged in yet."""
    device = PtyPort(tmp_path / 'device')
    yield device
    device.unplug()
