# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""When the currents of each board are read: in turn, and rarely from a board without them."""

from __future__ import annotations


import numpy as np
import pytest
from smart_tire.drivers.motor_board import Board, CurrentReader, WheelEncoder
from smart_tire.parameters import MotorDriverParams
from smart_tire.samples import NS_PER_S

ADDRESSES = (128, 129)


def readings(period, seconds, silent=()):
    """Return the times [s] of the requests to each board in ``seconds`` of polls."""
    now, asked, before = [0.0], {address: [] for address in ADDRESSES}, []

    class Line:

        def ask(self, address, command, wait):
            assert wait <= min(period, 0.02)
            asked[address].append(now[0])
            return None if address in silent else (0, 0)

    class Clock:
        def now_ns(self):
            return round(now[0] * NS_PER_S)

    boards = [Board(address, str(address), [WheelEncoder(1, 2000)] * 2, [], span_ns=1)
              for address in ADDRESSES]
    reader = CurrentReader(MotorDriverParams(), boards, Line(), period, Clock())
    for poll in range(round(seconds / period)):
        now[0] = poll * period
        reader.read(lambda: before.append(now[0]))
        assert reader.silent_boards() == [
            str(address) for address in silent if len(asked[address]) >= 4]
        for board in boards:  # torques are those of this poll only
            assert np.isfinite(board.torques).all() == (
                board.address not in silent and asked[board.address][-1:] == now)
    assert reader.missing == sum(len(asked[address]) for address in silent)
    assert before == sorted(sum(asked.values(), []))  # once before each request
    return asked.values()


@pytest.mark.parametrize(('rate', 'interval'), [(16.0, 1), (50.0, 1), (100.0, 2), (200.0, 4)])
def test_currents_are_read_at_50_hz_at_most_and_in_turn(rate, interval):
    front, rear = readings(1.0 / rate, 1.0)
    for times in (front, rear):
        assert np.diff(times) == pytest.approx(interval / rate)
        assert len(times) == rate // interval
    assert len({*front, *rear}) == rate * min(1.0, 2.0 / interval)  # not in the same poll


def test_a_board_without_currents_is_asked_at_doubling_intervals_up_to_10_s(monkeypatch):
    silent, other = readings(0.0625, 60.0, {128})
    waits = [0.0625, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 10.0, 10.0, 10.0, 10.0]
    assert np.diff(silent) == pytest.approx(waits)
    assert np.diff(other) == pytest.approx(0.0625)
