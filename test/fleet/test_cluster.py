# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Calls on a cluster of processes, of which a worker dies and the scheduler is restarted."""

from __future__ import annotations

from contextlib import closing
import os
from pathlib import Path
import signal
import time

import pytest

from smart_tire.errors import ParameterError
from smart_tire.fleet import running
from smart_tire.fleet.running import run_each
from support.fleet import Cluster, square, wait_for_file
from support.waiting import wait_for

pytest.importorskip('distributed', reason='needs dask.distributed')
pytestmark = pytest.mark.processes


@pytest.fixture
def cluster(monkeypatch):
    """Return a running cluster, whose workers find the functions of the tests."""
    monkeypatch.setenv('PYTHONPATH', os.pathsep.join(
        [str(Path(__file__).parents[1]), os.environ['PYTHONPATH']]))
    with Cluster() as found:
        yield found


def test_a_dead_worker_and_a_restarted_scheduler_lose_nothing(cluster, tmp_path, monkeypatch):
    monkeypatch.setattr(running, 'CONNECT_TRIES', 100)  # on a busy machine
    items = [tmp_path / name for name in 'abcdef']
    found = []
    with closing(run_each(wait_for_file, items, cluster=cluster.address,
                          wait=time.sleep)) as results:
        items[0].touch()
        found.append(next(results))
        for file in items[1:3]:  # one of them on each worker
            wait_for(lambda file=file: file.with_name(f'{file.name}.began').exists())
        cluster.workers.pop(0).__exit__()  # kills it
        cluster.add_worker()
        items[1].touch()
        items[2].touch()
        found += [next(results), next(results)]
        cluster.scheduler.signal(signal.SIGKILL)
        for worker in cluster.workers:
            worker.signal(signal.SIGKILL)
            worker.end()
        cluster.scheduler.end()
        cluster.start()
        for file in items[3:]:
            file.touch()
        found += list(results)
    assert sorted(found) == [(file, file) for file in items]


def test_an_unreachable_cluster_is_one_line(monkeypatch):
    monkeypatch.setattr(running, 'CONNECT_TIMEOUT', 0.5)
    later = Cluster(workers=1)
    with pytest.raises(ParameterError) as raised:
        list(run_each(square, [1], cluster=later.address, wait=time.sleep))
    assert str(raised.value).startswith(f'cluster {later.address}: not reached in 0 s (')
    assert '\n' not in str(raised.value)
