# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Verdict on bounds in real time, with made-up statistics of the scheduler."""

from __future__ import annotations

import os
import shutil

import pytest
from support.verdict import assert_within, MAX_TRIALS, RunQueues, Verdict, verdict


@pytest.mark.parametrize(('measured', 'waited', 'expected'), [
    (0.4, 0.0, Verdict.PASS), (0.5, 0.0, Verdict.PASS), (0.5, 0.4, Verdict.PASS),
    (0.51, 0.0, Verdict.FAIL), (0.9, 0.39, Verdict.FAIL), (0.75, 0.25, Verdict.INCONCLUSIVE),
    (0.9, 0.41, Verdict.INCONCLUSIVE), (0.9, 5.0, Verdict.INCONCLUSIVE)])
def test_a_time_above_the_bound_fails_if_waiting_does_not_explain_it(measured, waited, expected):
    assert verdict(measured, waited, 0.5) is expected


def waits(proc, process, **threads):
    """Write the waiting time [ms] of each thread of a process."""
    for name, waited in threads.items():
        folder = proc / str(process) / 'task' / name.lstrip('t')
        folder.mkdir(parents=True, exist_ok=True)
        (folder / 'schedstat').write_text(f'123456789 {round(waited * 1e6)} 42\n')


def test_waiting_times_of_all_threads_of_all_processes_are_added(tmp_path):
    waits(tmp_path, 10, t10=100, t11=20)
    waits(tmp_path, 20, t20=7)
    waits(tmp_path, 30, t30=1000)
    queues = RunQueues(10, 20, proc=tmp_path)
    assert queues.seconds() == 0.0
    waits(tmp_path, 10, t10=105, t11=21)
    waits(tmp_path, 20, t20=9)
    waits(tmp_path, 30, t30=2000)
    assert queues.seconds() == pytest.approx(0.008)


def test_threads_and_processes_that_start_later_count_from_their_begin(tmp_path):
    waits(tmp_path, 10, t10=100)
    queues = RunQueues(10, proc=tmp_path)
    waits(tmp_path, 10, t12=30)
    waits(tmp_path, 20, t20=50)
    queues.add(20)
    waits(tmp_path, 20, t20=53, t21=4)
    assert queues.seconds() == pytest.approx(0.030 + 0.003 + 0.004)


def test_a_process_that_ends_counts_until_it_was_last_read(tmp_path):
    waits(tmp_path, 10, t10=100)
    queues = RunQueues(10, 20, proc=tmp_path)
    waits(tmp_path, 10, t10=140)
    queues.seconds()
    shutil.rmtree(tmp_path / '10')
    assert queues.seconds() == pytest.approx(0.040)


def test_statistics_that_the_kernel_does_not_have_count_as_no_waiting(tmp_path):
    (tmp_path / '10' / 'task' / '10').mkdir(parents=True)
    assert RunQueues(10, proc=tmp_path).seconds() == 0.0


def test_the_statistics_of_this_kernel_are_read():
    queues = RunQueues(os.getpid())
    assert 0.0 <= queues.seconds() <= queues.seconds()


def run(*trials):
    """Assert a bound of half a second on ``trials``; return how many of them were made."""
    left = list(trials)
    assert_within(0.5, lambda: left.pop(0))
    return len(trials) - len(left)


def test_a_scenario_is_repeated_until_it_is_within_the_bound():
    unclear, good, bad = (0.7, 0.4), (0.3, 0.0), (0.7, 0.1)
    assert run(good, unclear) == 1
    assert run(unclear, bad, good, good) == 3
    with pytest.raises(AssertionError, match=r'0.700 s with 0.100 s on run queues; .* 0.5 s'):
        run(unclear, bad, *[unclear] * (MAX_TRIALS - 2))


def test_a_scenario_that_remains_inconclusive_is_skipped_with_its_figures():
    with pytest.raises(pytest.skip.Exception, match='^inconclusive: .*0.704 s with 0.400 s'):
        run(*((0.7 + 0.001 * number, 0.4) for number in range(MAX_TRIALS)))
