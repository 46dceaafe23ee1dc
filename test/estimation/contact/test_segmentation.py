"""Contacts: activity over the rolled distance, whatever time does."""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np
import pytest

from smart_tire.estimation.contact.segmentation import SegmentExtractor
from smart_tire.estimation.contact.wheel_trajectory import ReversalDetector
from smart_tire.parameters import RobotParams
from support.rolling import along, films, ROUND, START_NS, steady

ROBOT = RobotParams()
PERIOD_NS = 2_500_000
CONTACT = ROBOT.tire.contact_length + ROBOT.film.length
THRESHOLDS = (0.2, 0.16)


def contacts_of(samples, course, block=20):
    """Return the contacts in ``samples``, fed in blocks with a perfectly known course."""
    record = SegmentExtractor(THRESHOLDS, ROBOT.film.rest_voltage, PERIOD_NS, CONTACT)
    path, found = ReversalDetector(0.003), []
    for start in range(0, len(samples), block):
        chunk = samples[start:start + block]
        instants = np.array([sample.stamp_ns for sample in chunk])
        places = course((instants - START_NS) * 1e-9)
        turns = [instant for instant, _ in path.advance(instants, places)]
        found += record.add(instants, places, np.array([s.volts for s in chunk]), turns)
    return found, record


@pytest.mark.parametrize('slip', [0.0, 0.1, 0.3, -0.1, -0.3])
@pytest.mark.parametrize('rpm', [15.0, 60.0, 200.0])
def test_each_film_has_one_contact_per_turn_at_any_speed_and_slip(rpm, slip):
    course = steady(rpm)
    duration = 0.5 + 4.0 * 60.0 / rpm
    samples = films(course, duration, slip=slip, total=abs(slip) + 0.03, noise=0.02)
    found, _ = contacts_of(samples, course)
    assert [sum(c.film == film for c in found) for film in (0, 1)] == [4, 4]


def test_noise_bumps_and_standing_still_make_no_contact():
    course = along([(0.0, 0.0), (1.0, 0.0), (2.0, 0.19), (4.0, 0.19)])  # up to the first bump
    assert contacts_of(films(course, 4.0, noise=0.02), course)[0] == []


def test_waiting_inside_the_patch_is_one_contact_however_long_it_takes():
    quick = along([(0.0, 0.0), (1.0, 0.6)])
    slow = along([(0.0, 0.0), (0.5, 0.30), (6.0, 0.30), (6.5, 0.6)])
    for course, duration in ((quick, 1.0), (slow, 6.5)):
        found, _ = contacts_of(films(course, duration, spread=0.0), course)
        assert sorted(c.film for c in found) == [0, 1]
        assert all(len(c.instants) < 400 for c in found)


def test_a_turn_inside_the_patch_ends_the_contact_there():
    course = along([(0.0, 0.0), (0.5, 0.30), (1.0, 0.0)])
    found, _ = contacts_of(films(course, 1.0), course)
    first = [c for c in found if c.film == 0]
    assert len(first) == 2
    turn = START_NS + 500_000_000
    assert abs(first[0].end_ns - turn) < 10_000_000
    assert first[1].instants[0] >= turn - 10_000_000


def test_a_gap_is_lost_time_and_no_rest():
    course = steady(60.0)
    samples = films(course, 1.5)
    begin, end = START_NS + 1_040_000_000, START_NS + 1_080_000_000
    kept = [s for s in samples if not begin <= s.stamp_ns < end]
    found, record = contacts_of(kept, course)
    assert sorted(c.film for c in found) == [0, 1]
    assert record.lost(begin, end) > 0.9
    assert record.lost(START_NS, begin) < 0.05
    assert record.lost(START_NS - 10**9, START_NS) > 0.99


@pytest.mark.parametrize('rpm', [15.0, 60.0, 200.0])
def test_contacts_do_not_hang_on_the_blocks_in_which_samples_come(rpm):
    course = steady(rpm)
    samples = films(course, 0.5 + 3.0 * 60.0 / rpm, slip=0.1, total=0.13)
    whole, single, few = (contacts_of(samples, course, block)[0]
                          for block in (len(samples), 1, 37))
    spans = [np.array(sorted((c.film, c.begin_ns, c.end_ns) for c in found))
             for found in (whole, single, few)]
    assert len(spans[0]) == 6
    for other in spans[1:]:
        assert np.array_equal(other[:, 0], spans[0][:, 0])
        # the rest voltage is followed from block to block: a millimetre or two of travel
        apart = np.max(np.abs(other[:, 1:] - spans[0][:, 1:]))
        assert apart <= PERIOD_NS + 0.002 / ROUND * 60e9 / rpm


def test_a_film_that_was_absent_for_a_while_is_seen_again():
    course = steady(60.0)
    samples = films(course, 6.0)
    gone = [replace(s, volts=(s.volts[0], math.nan))
            if START_NS + 10**9 < s.stamp_ns < START_NS + 2 * 10**9 else s for s in samples]
    found, _ = contacts_of(gone, course)
    assert sum(c.film == 0 for c in found) == 5
    assert sum(c.film == 1 for c in found) == 4


def test_a_rest_voltage_that_is_not_the_described_one_is_learned():
    course = steady(60.0)
    samples = films(course, 8.0)
    shifted = [type(s)(s.stamp_ns, s.wheel, tuple(v + 0.3 for v in s.volts)) for s in samples]
    found, record = contacts_of(shifted, course)
    assert record.stuck > 0
    late = [c for c in found if c.begin_ns > START_NS + 4 * 10**9]
    assert len(late) >= 6
    assert all(abs(c.rest - 1.95) < 0.02 for c in late)


def test_the_contact_carries_the_samples_from_before_entry_to_after_release():
    course = steady(60.0)
    found, _ = contacts_of(films(course, 1.5), course)
    places = course((found[0].instants - START_NS) * 1e-9)
    assert places[-1] - places[0] > CONTACT
    assert np.all(np.diff(found[0].instants) > 0)
    assert places[-1] - places[0] < 0.3 * ROUND
