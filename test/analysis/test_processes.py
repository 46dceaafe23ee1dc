# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Stages in processes of their own: items, errors and shutdown."""

import multiprocessing
import os

import numpy as np
import pytest

from smart_tire.analysis.processes import pipelined
from smart_tire.errors import BagError, EstimatorError

pytestmark = pytest.mark.processes


@pytest.fixture(params=[1, 2])
def cores(request, monkeypatch):
    """Simulate a machine with one core, then two."""
    monkeypatch.setattr(os, 'sched_getaffinity', lambda pid: set(range(request.param)))
    return request.param


two_cores = pytest.mark.parametrize('cores', [2], indirect=True)


def squares():
    for number in range(1000):
        yield number ** 2, os.getpid()


def arrays():
    yield {'empty': np.empty(0), 'rows': np.arange(300_000.0).reshape(-1, 3),
           'columns': np.arange(6.0).reshape(2, 3).T, 'part': np.arange(9.0)[::2]}


def failing():
    yield 1
    raise BagError('the disk is full of sand')


def dying():
    yield 1
    os._exit(3)


def endless():
    while True:
        yield b'x' * 1000


def with_process(items):
    for item in items:
        yield *item, os.getpid()


def failing_after_two(items):
    yield next(items)
    yield next(items)
    raise BagError('the map is blank')


def dying_after_two(items):
    yield next(items)
    yield next(items)
    os._exit(3)


@pytest.mark.parametrize('stages', [0, 1, 2])
def test_all_items_come_in_order_each_stage_in_its_process(cores, stages):
    items = list(pipelined(squares, *[with_process] * stages))
    assert [square for square, *_ in items] == [number ** 2 for number in range(1000)]
    own, = {tuple(processes) for _, *processes in items}
    assert len({os.getpid(), *own}) == (1 if cores == 1 else 2 + stages)


def test_arrays_arrive_as_they_are_and_may_be_changed(cores):
    (found,), (expected,) = pipelined(arrays), arrays()
    for name, array in expected.items():
        np.testing.assert_array_equal(found[name], array)
        found[name] += 1.0


def test_errors_of_the_package_are_raised_after_the_preceding_items(cores):
    items = pipelined(failing)
    assert next(items) == 1
    with pytest.raises(BagError, match='full of sand'):
        next(items)


def test_errors_of_any_stage_are_raised(cores):
    items = pipelined(failing, iter, iter)
    assert next(items) == 1
    with pytest.raises(BagError, match='full of sand'):
        next(items)
    with pytest.raises(BagError, match='map is blank'):
        list(pipelined(endless, failing_after_two, iter))


@two_cores
@pytest.mark.parametrize('stages', [0, 1])
def test_a_process_that_dies_is_an_error(cores, stages):
    items = pipelined(dying, *[iter] * stages)
    assert next(items) == 1
    with pytest.raises(EstimatorError, match='has died'):
        next(items)


@two_cores
def test_a_later_stage_that_dies_is_an_error_and_ends_the_first_one(cores):
    items = pipelined(endless, dying_after_two, iter)
    assert [next(items), next(items)] == [b'x' * 1000] * 2
    with pytest.raises(EstimatorError, match='has died'):
        next(items)
    assert multiprocessing.active_children() == []


@two_cores
@pytest.mark.parametrize('stages', [0, 2])
def test_closing_the_iterator_ends_all_processes(cores, stages):
    items = pipelined(endless, *[iter] * stages)
    assert next(items) == b'x' * 1000
    items.close()
    assert multiprocessing.active_children() == []
