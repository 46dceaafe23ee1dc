# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Prefetching in a second process: items, errors and shutdown."""

import multiprocessing
import os

import numpy as np
import pytest

from smart_tire.analysis.offline import prefetch
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


def test_all_items_come_in_order_from_either_process(cores):
    items = list(prefetch(squares))
    assert [square for square, _ in items] == [number ** 2 for number in range(1000)]
    assert {pid == os.getpid() for _, pid in items} == {cores == 1}


def test_arrays_arrive_as_they_are_and_may_be_changed(cores):
    (found,), (expected,) = prefetch(arrays), arrays()
    for name, array in expected.items():
        np.testing.assert_array_equal(found[name], array)
        found[name] += 1.0


def test_errors_of_the_package_are_raised_after_the_preceding_items(cores):
    items = prefetch(failing)
    assert next(items) == 1
    with pytest.raises(BagError, match='full of sand'):
        next(items)


@two_cores
def test_a_process_that_dies_is_an_error(cores):
    items = prefetch(dying)
    assert next(items) == 1
    with pytest.raises(EstimatorError, match='has died'):
        next(items)


@two_cores
def test_closing_the_iterator_ends_the_process(cores):
    items = prefetch(endless)
    assert next(items) == b'x' * 1000
    items.close()
    assert multiprocessing.active_children() == []
