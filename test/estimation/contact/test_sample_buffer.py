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

"""Buffer of film samples up to the instant at which the wheel angle is known."""

from __future__ import annotations

import numpy as np

from smart_tire.estimation.contact.sample_buffer import FilmSampleBuffer
from smart_tire.samples import TireSample

PERIOD_NS = 2_500_000


def filled(films, volts):
    buffer = FilmSampleBuffer(films, PERIOD_NS)
    for i, row in enumerate(volts):
        buffer.add(TireSample(i * PERIOD_NS, 'front_right', row))
    return buffer


def test_samples_are_taken_once_and_up_to_an_instant():
    buffer = filled((0, 1), [(0.1 * i, 1.65) for i in range(10)])
    instants, volts = buffer.take(4 * PERIOD_NS)
    assert instants.tolist() == [i * PERIOD_NS for i in range(5)]
    assert volts[:, 0].tolist() == [0.1 * i for i in range(5)]
    assert len(buffer.take(20 * PERIOD_NS)[0]) == 5
    assert buffer.take(20 * PERIOD_NS)[1].shape == (0, 2)


def test_only_the_films_of_the_group_are_returned():
    _, volts = filled((1, 2), [(0.0, 1.0, 2.0, 3.0)] * 3).take(PERIOD_NS)
    assert volts.tolist() == [[1.0, 2.0]] * 2


def test_absent_films_are_nan():
    _, volts = filled((0, 1), [(0.0, 1.0), (0.0,)]).take(PERIOD_NS)
    assert np.isnan(volts).tolist() == [[False, False], [False, True]]


def test_a_cleared_buffer_is_empty():
    buffer = filled((0,), [(1.65,)] * 3)
    buffer.clear()
    assert len(buffer.take(10 * PERIOD_NS)[0]) == 0
