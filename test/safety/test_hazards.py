# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Every hazard of ``docs/safety.md`` in virtual time: no stop takes longer than its bound."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import given, settings, strategies as st, target
import pytest
from support.hazards import (
    ACTORS, conditions_of, HAZARDS, longest, MARGIN, MAX_LATENESS, MAX_STALL, PHASES, RATES,
    README, recorded, runs_of, SENTENCE, sentence, worst)

hazards = pytest.mark.parametrize('name', HAZARDS)
TOPICS = ('motor_commands', 'wheel_states', 'cmd_vel')
SOON = st.floats(-MAX_STALL, 0.3)  # s, since the fault


@hazards
def test_the_wheels_stop_within_the_bound_at_every_phase(name):
    seconds, number = worst(name, 16.0, runs_of(name))
    assert seconds <= HAZARDS[name].bound, number


@hazards
@pytest.mark.parametrize('rate', [rate for rate in RATES if rate != 16.0])
def test_the_wheels_stop_within_the_bound_at_other_rates(name, rate):
    seconds, number = worst(name, rate, 4)
    assert seconds <= HAZARDS[name].bound, number


@pytest.mark.long
@hazards
@pytest.mark.parametrize('rate', RATES)
def test_the_recorded_worst_stop_time_is_that_of_the_code(name, rate):
    assert longest((name, rate)) == pytest.approx(recorded()[name][rate], abs=1e-3)


@hazards
def test_no_bound_is_far_above_the_worst_stop_time(name):
    found = max(recorded()[name].values())
    assert found <= HAZARDS[name].bound <= MARGIN * found


def test_the_readme_has_the_bounds():
    assert SENTENCE.search(README.read_text(encoding='utf-8'))[0] == sentence()


@settings(max_examples=200)
@given(name=st.sampled_from(sorted(HAZARDS)), rate=st.sampled_from(RATES),
       number=st.integers(0, 2 * PHASES),
       stalls=st.tuples(*(st.tuples(SOON, st.floats(0.0, MAX_STALL)) for _ in ACTORS)),
       late=st.tuples(*(st.tuples(st.integers(0, 9), st.floats(0.0, MAX_LATENESS))
                        for _ in TOPICS)),
       lost=st.tuples(st.sampled_from(TOPICS), st.integers(0, 9)),
       doubled=st.tuples(st.sampled_from(TOPICS), st.integers(0, 9)))
def test_no_disturbance_within_the_allowance_delays_a_stop_beyond_the_bound(
        name, rate, number, stalls, late, lost, doubled):
    conditions = replace(
        conditions_of(name, number, rate),
        stalls=tuple((actor, *stall) for actor, stall in zip(ACTORS, stalls)),
        late=tuple((topic, *one) for topic, one in zip(TOPICS, late)),
        lost=(lost,), doubled=(doubled,))
    seconds = HAZARDS[name].stop_time(conditions, number)
    target(seconds / HAZARDS[name].bound)
    assert seconds <= HAZARDS[name].bound
