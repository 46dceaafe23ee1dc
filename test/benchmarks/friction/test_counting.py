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

"""Which crossings of a constructed run count."""

from __future__ import annotations

from benchmarks.friction.counting import counted, excited, revolutions_on_ground
from benchmarks.friction.records import FUSED, QUANTITIES, Rows
from benchmarks.slip.series import Truth
import numpy as np
from smart_tire.analysis.series import PoseSeries
from smart_tire.samples import NS_PER_S

RADIUS = 0.087  # m


def rows(mu, stiffness=None, stamps=None):
    """Return crossings with true ``mu`` and stiffness, one per second by default."""
    n = len(mu)
    true = {name: np.ones(n) for name in QUANTITIES}
    true |= {FUSED: np.array(mu, float),
             'stiffness': np.full(n, 52.7) if stiffness is None else np.array(stiffness, float)}
    seconds = np.arange(1.05, n + 1.0) if stamps is None else np.array(stamps)
    return Rows((seconds * NS_PER_S).astype(np.int64), np.full(n, 0.5), np.full(n, 0.02),
                np.ones(n, bool), true, true, true, 0)


def truth(seconds, speed=0.5, yaw_rate=0.0, starts=()):
    """Return a run at constant speed; ``yaw_rate`` is a function of time or a constant."""
    time = np.arange(0.0, seconds, 0.01)
    stamps = np.round(time * NS_PER_S).astype(np.int64)
    rolling = np.full((len(time), 4), speed)
    for begin, end in starts:
        rolling[(time >= begin) & (time < end)] = 0.0
    twist = np.zeros((len(time), 3))
    twist[:, 2] = yaw_rate(time) if callable(yaw_rate) else yaw_rate
    poses = PoseSeries(stamps, np.zeros((len(time), 3)), twist, np.zeros((len(time), 3, 3)),
                       np.zeros((len(time), 3)))
    return Truth(stamps, poses, np.zeros((len(time), 4)), rolling, RADIUS)


def test_revolutions_count_from_the_last_change_of_friction_or_stiffness():
    found = revolutions_on_ground(rows([.47] * 3 + [.25] * 3 + [.25] * 2,
                                       [52.7] * 3 + [25.0] * 3 + [60.0] * 2))
    assert found.tolist() == [1, 2, 3, 1, 2, 3, 1, 2]


def test_a_crossing_on_two_grounds_is_a_ground_of_its_own():
    assert revolutions_on_ground(rows([.47, .47, .36, .25, .25])).tolist() == [1, 2, 1, 1, 2]


def test_rounding_of_a_mean_is_no_change():
    assert revolutions_on_ground(rows([.47, .47 + 1e-12, .47])).tolist() == [1, 2, 3]


def test_crossings_count_from_the_fifth_revolution():
    assert np.flatnonzero(counted(rows([.47] * 7 + [.2] * 6))).tolist() == [4, 5, 6, 11, 12]
    assert np.flatnonzero(counted(rows([.47] * 5 + [.2] * 4), 4)).tolist() == [3, 4, 8]


def test_without_a_turn_start_or_stop_nothing_is_expected():
    straight = truth(20.0)
    assert not excited(rows([.47] * 15), straight).any()
    turning = truth(20.0, yaw_rate=0.5)
    assert np.flatnonzero(excited(rows([.47] * 15), turning))[0] == 4  # after 5 s


def test_an_excitation_on_the_previous_ground_does_not_count():
    turn_first = truth(30.0, yaw_rate=lambda time: np.where(time < 8.0, 0.5, 0.0))
    stiffness = [52.7] * 10 + [25.0] * 18
    assert not excited(rows([.47] * 28, stiffness), turn_first)[10:].any()
    stop_later = truth(30.0, starts=[(14.0, 15.0)])
    found = excited(rows([.47] * 28, stiffness), stop_later)
    assert not found[:13].any()
    assert found[17:].all()  # six seconds on the second ground, one of them stationary


def test_an_excitation_counts_while_the_stiffness_stays():
    turn_first = truth(30.0, yaw_rate=lambda time: np.where(time < 8.0, 0.5, 0.0))
    assert excited(rows([.47] * 10 + [.2] * 10), turn_first)[5:].all()


def test_time_at_standstill_is_no_motion():
    standing = truth(30.0, yaw_rate=0.5, starts=[(0.0, 10.0)])
    found = excited(rows([.47] * 8, stamps=np.arange(11.05, 19.0)), standing)
    assert np.flatnonzero(found)[0] == 4  # at 15 s, after 5 s of motion
