"""The spool gives back what it was given, in memory or on a disk."""

import tempfile

import pytest

from smart_tire.errors import EstimatorError
from smart_tire.estimation.slip import block_spool
from smart_tire.estimation.slip.block_spool import Spool


@pytest.mark.parametrize('in_memory', [1, 1 << 20])
def test_blocks_come_back_in_any_order_and_can_be_replaced(monkeypatch, in_memory):
    monkeypatch.setattr(block_spool, 'IN_MEMORY', in_memory)
    kept = Spool()
    places = [kept.append(bytes([i]) * 100, room=150) for i in range(20)]
    items = kept.append_items([('a', 1), ('b', 2)])
    kept.replace(places[3], b'x' * 150)
    assert kept.read(places[19], 100) == b'\x13' * 100
    assert kept.read(places[3], 150) == b'x' * 150
    assert kept.read(places[4], 100) == b'\x04' * 100
    assert kept.items(items) == [('a', 1), ('b', 2)]
    kept.close()


def test_a_disk_without_room_is_an_error_that_says_where(monkeypatch):
    monkeypatch.setattr(block_spool, 'IN_MEMORY', 10)
    monkeypatch.setattr(tempfile, 'tempdir', '/nowhere/at/all')
    kept = Spool()
    with pytest.raises(EstimatorError, match='no room in /nowhere/at/all for 100 bytes'):
        kept.append(b'x' * 100)
