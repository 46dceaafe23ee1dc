# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Spool: blocks are read back unchanged, from memory and from disk."""

import tempfile

import pytest

from smart_tire.errors import EstimatorError
from smart_tire.estimation.slip import block_spool
from smart_tire.estimation.slip.block_spool import Spool


@pytest.mark.parametrize('max_memory', [1, 1 << 20])
def test_blocks_can_be_read_in_any_order_and_replaced(monkeypatch, max_memory):
    monkeypatch.setattr(block_spool, 'MAX_MEMORY', max_memory)
    spool = Spool()
    offsets = [spool.append(bytes([i]) * 100, reserve=150) for i in range(20)]
    items = spool.append_items([('a', 1), ('b', 2)])
    spool.replace(offsets[3], b'x' * 150)
    assert spool.read(offsets[19], 100) == b'\x13' * 100
    assert spool.read(offsets[3], 150) == b'x' * 150
    assert spool.read(offsets[4], 100) == b'\x04' * 100
    assert spool.items(items) == [('a', 1), ('b', 2)]
    spool.close()


def test_a_full_disk_raises_an_error_that_names_the_directory(monkeypatch):
    monkeypatch.setattr(block_spool, 'MAX_MEMORY', 10)
    monkeypatch.setattr(tempfile, 'tempdir', '/nowhere/at/all')
    spool = Spool()
    with pytest.raises(EstimatorError, match='cannot write 100 bytes to /nowhere/at/all'):
        spool.append(b'x' * 100)
