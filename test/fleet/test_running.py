# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Calls in several processes: outcomes, failures, dead processes, and how they end."""

from __future__ import annotations

from contextlib import closing
import os

import pytest

from smart_tire.errors import BagError
from smart_tire.fleet import running
from smart_tire.fleet.running import jobs_for, run_each
from support.fleet import fail_or_die, square, wait_for_file
from support.waiting import wait_for

pytestmark = pytest.mark.processes


def never(seconds):
    raise AssertionError(f'waits {seconds} s')


@pytest.mark.parametrize('jobs', [0, 1, 3])
def test_each_item_has_what_the_function_returns(jobs):
    found = dict(run_each(square, iter(range(20)), jobs=jobs, wait=never))
    assert found == {item: item * item for item in range(20)}


def test_no_more_items_are_taken_than_are_running():
    taken = []

    def items():
        for item in range(20):
            taken.append(item)
            yield item

    for done, _ in enumerate(run_each(square, items(), jobs=2, wait=never)):
        assert len(taken) <= done + 2


@pytest.mark.parametrize('jobs', [1, 2])
def test_an_error_and_a_dead_process_do_not_stop_the_others(jobs):
    items = ['a', 'die', 'fail', *'bcdefg']
    found = dict(run_each(fail_or_die, items, jobs=jobs, wait=never))
    assert found.keys() == {*items}
    assert all(found[item] == item for item in 'abcdefg')
    assert repr(found['fail']) == "ZeroDivisionError('as requested')"
    assert isinstance(found['die'], BagError) and 'has died' in str(found['die'])


def test_closing_the_iterator_ends_what_runs(tmp_path):
    results = run_each(wait_for_file, [tmp_path / 'a', tmp_path / 'b'], jobs=2, wait=never)
    with closing(results):
        (tmp_path / 'a').touch()
        assert next(results) == (tmp_path / 'a', tmp_path / 'a')
        wait_for((tmp_path / 'b.began').exists)
    assert not (tmp_path / 'b').exists()  # the call has not waited for it


def test_processes_are_limited_by_bags_cores_and_memory(monkeypatch):
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: set(range(8)))
    for free, expected in ((0.1, 1), (2.5, 2), (100.0, 8)):
        monkeypatch.setattr(running, '_free_memory', lambda free=free: (
            free * running.MEMORY_PER_BAG))
        assert jobs_for(1000) == expected
        assert jobs_for(1000, 5) == 5 and jobs_for(1) == jobs_for(1, 5) == 1
    monkeypatch.undo()
    total = os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES')
    assert 0 < running._free_memory() <= total
