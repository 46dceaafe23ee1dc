"""A second process works ahead: same items, same errors, and never left behind."""

import multiprocessing
import os

import pytest

from smart_tire.analysis.prefetch import ahead
from smart_tire.errors import BagError, EstimatorError


@pytest.fixture(params=[1, 2])
def cores(request, monkeypatch):
    """Pretend that the machine has one core, then two."""
    monkeypatch.setattr(os, 'sched_getaffinity', lambda pid: set(range(request.param)))
    return request.param


@pytest.fixture
def two_cores(monkeypatch):
    """Pretend that the machine has two cores."""
    monkeypatch.setattr(os, 'sched_getaffinity', lambda pid: {0, 1})


def squares():
    for number in range(1000):
        yield number ** 2, os.getpid()


def failing():
    yield 1
    raise BagError('the disk is full of sand')


def dying():
    yield 1
    os._exit(3)


def endless():
    while True:
        yield b'x' * 1000


def test_all_items_come_in_order_whoever_makes_them(cores):
    items = list(ahead(squares))
    assert [square for square, _ in items] == [number ** 2 for number in range(1000)]
    assert {pid == os.getpid() for _, pid in items} == {cores == 1}


def test_errors_of_the_package_come_through_after_the_items_before(cores):
    items = ahead(failing)
    assert next(items) == 1
    with pytest.raises(BagError, match='full of sand'):
        next(items)


def test_a_process_that_dies_is_an_error_and_not_the_end(two_cores):
    items = ahead(dying)
    assert next(items) == 1
    with pytest.raises(EstimatorError, match='has died'):
        next(items)


def test_an_iterator_that_is_given_up_leaves_no_process_behind(two_cores):
    items = ahead(endless)
    assert next(items) == b'x' * 1000
    items.close()
    assert multiprocessing.active_children() == []
