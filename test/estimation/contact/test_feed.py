# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The feed of the contact trackers: order, validity and restarts."""

from dataclasses import replace
import random

import numpy as np
import pytest
from smart_tire.estimation.contact.feed import ContactFeed
from smart_tire.samples import NS_PER_S, TireSample
from support.rolling import films, in_order, passes, ROBOT, stamp, steady, WHEEL, wheels

WINDOW = 0.06   # s
DURATION = 4.0  # s
TRAJECTORY = steady(90.0)


@pytest.fixture(scope='module')
def samples():
    """Return tire and wheel samples of a few revolutions."""
    return in_order(films(TRAJECTORY, DURATION), wheels(TRAJECTORY, DURATION))


def blocks(feed, samples):
    return [block for sample in samples for block in feed.add_sample(sample)]


def crossings(found):
    return [(wheel, crossing.stamp_ns) for block in found for wheel, crossing in block.crossings]


def test_every_crossing_is_found_with_its_wheel(samples):
    found = crossings(blocks(ContactFeed(ROBOT, WINDOW), samples))
    expected = [t for t in passes(TRAJECTORY, DURATION) if t < DURATION - 0.4]
    assert [ns for _, ns in found] == pytest.approx([stamp(t) for t in expected], abs=5e6)
    assert {wheel for wheel, _ in found} == {WHEEL}


def test_the_last_crossings_are_found_at_the_end_of_the_samples():
    reach = 0.5 * (ROBOT.tire.contact_length + ROBOT.film.length + ROBOT.film.spacing)
    times = passes(TRAJECTORY, DURATION)
    half = reach / float(TRAJECTORY(times[1] + 0.5) - TRAJECTORY(times[1] - 0.5))  # s
    for end in np.arange(times[1] + 0.5 * half, times[2] + 3.0 * half, 0.035):
        some = in_order(films(TRAJECTORY, end), wheels(TRAJECTORY, end))
        feed = ContactFeed(ROBOT, WINDOW)
        early, late = crossings(blocks(feed, some)), crossings(feed.finish())
        complete = [t for t in passes(TRAJECTORY, end) if t + half < end - 0.005]
        possible = [t for t in passes(TRAJECTORY, end) if t + half < end + 0.005]
        found = [ns for _, ns in early + late]
        assert len(complete) <= len(found) <= len(possible)
        assert found == pytest.approx([stamp(t) for t in possible[:len(found)]], abs=5e6)
        assert late or end > possible[-1] + 0.25  # some time after the crossing
        assert crossings(feed.finish()) == []


def test_samples_come_in_order_of_time_for_any_order_of_reception(samples):
    rng = random.Random(1)
    shuffled = sorted(samples, key=lambda sample: sample.stamp_ns + rng.uniform(0.0, 4e7))
    ordered, mixed = (blocks(ContactFeed(ROBOT, WINDOW), some) for some in (samples, shuffled))
    assert [s.stamp_ns for block in mixed for s in block.samples] == sorted(
        s.stamp_ns for block in mixed for s in block.samples)
    assert crossings(mixed) == crossings(ordered)


def test_duplicates_and_foreign_wheels_are_counted_and_not_passed_on(samples):
    feed = ContactFeed(ROBOT, WINDOW)
    films_only = [sample for sample in samples if isinstance(sample, TireSample)]
    foreign = [replace(sample, wheel='rear_left') for sample in films_only]
    found = blocks(feed, in_order(samples, films_only, foreign))
    accepted = [sample for block in found for sample in block.samples]
    assert len(accepted) == len(set(map(id, accepted))) and feed.foreign_samples > 1000
    assert feed.dropped['tire_samples'] > 1000 and set(feed.dropped) == {'tire_samples'}
    assert all(sample.wheel == WHEEL for sample in accepted if isinstance(sample, TireSample))


def test_a_clock_that_is_set_back_restarts_the_trackers(samples):
    earlier = [replace(sample, stamp_ns=sample.stamp_ns - 100 * NS_PER_S) for sample in samples]
    feed = ContactFeed(ROBOT, WINDOW)
    first, again = blocks(feed, samples), blocks(feed, earlier)
    assert [block.restarted for block in first + again].count(True) == feed.clock_resets == 1
    assert len(crossings(again)) == len(crossings(first))
