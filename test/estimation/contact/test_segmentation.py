# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Segmentation of film signals over rolled distance, independent of the time it takes."""

from dataclasses import replace
import math

import numpy as np
import pytest

from smart_tire.estimation.contact.records import FilmGroup
from smart_tire.estimation.contact.segmentation import FilmSampleBuffer, SegmentExtractor
from smart_tire.estimation.contact.trajectory import ReversalDetector
from smart_tire.parameters import RobotParams
from smart_tire.samples import TireSample
from support.rolling import along, films, ROUND, START_NS, steady

ROBOT = RobotParams()
PERIOD_NS = 2_500_000
CROSSING = ROBOT.tire.contact_length + ROBOT.film.length
GROUP = FilmGroup.of(ROBOT, 'front_right', (0, 1))


def segments_of(samples, trajectory, block=20):
    """Return the segments in ``samples``, added in blocks with an exactly known trajectory."""
    extractor = SegmentExtractor(GROUP, ROBOT.film.rest_voltage, PERIOD_NS)
    reversals, found = ReversalDetector(0.003), []
    for start in range(0, len(samples), block):
        chunk = samples[start:start + block]
        instants = np.array([sample.stamp_ns for sample in chunk])
        positions = trajectory((instants - START_NS) * 1e-9)
        found += extractor.extend(
            instants, positions, np.array([sample.volts for sample in chunk]),
            [instant for instant, _ in reversals.follow(instants, positions)])
    return found, extractor


@pytest.mark.parametrize('slip', [0.0, 0.1, 0.3, -0.1, -0.3])
@pytest.mark.parametrize('rpm', [15.0, 60.0, 200.0])
def test_each_film_has_one_segment_per_revolution_at_any_speed_and_slip(rpm, slip):
    trajectory = steady(rpm)
    duration = 0.5 + 4.0 * 60.0 / rpm
    samples = films(trajectory, duration, slip=slip, total=abs(slip) + 0.03, noise=0.02)
    found, _ = segments_of(samples, trajectory)
    assert [sum(segment.film == film for segment in found) for film in (0, 1)] == [4, 4]


def test_noise_bumps_and_standstill_cause_no_segment():
    # up to the first bump
    trajectory = along([(0.0, 0.0), (1.0, 0.0), (2.0, 0.19), (4.0, 0.19)])
    assert segments_of(films(trajectory, 4.0, noise=0.02), trajectory)[0] == []


def test_waiting_inside_the_patch_is_one_segment_independent_of_time():
    quick = along([(0.0, 0.0), (1.0, 0.6)])
    slow = along([(0.0, 0.0), (0.5, 0.30), (6.0, 0.30), (6.5, 0.6)])
    for trajectory, duration in ((quick, 1.0), (slow, 6.5)):
        found, _ = segments_of(films(trajectory, duration, spread=0.0), trajectory)
        assert sorted(segment.film for segment in found) == [0, 1]
        assert all(len(segment.instants) < 400 for segment in found)


def test_a_reversal_inside_the_patch_closes_the_segment():
    trajectory = along([(0.0, 0.0), (0.5, 0.30), (1.0, 0.0)])
    found, _ = segments_of(films(trajectory, 1.0), trajectory)
    first = [segment for segment in found if segment.film == 0]
    assert len(first) == 2
    reversal_ns = START_NS + 500_000_000
    assert abs(first[0].end_ns - reversal_ns) < 10_000_000
    assert first[1].instants[0] >= reversal_ns - 10_000_000


def test_a_gap_is_lost_time_and_does_not_close_a_segment():
    trajectory = steady(60.0)
    samples = films(trajectory, 1.5)
    begin, end = START_NS + 1_040_000_000, START_NS + 1_080_000_000
    kept = [sample for sample in samples if not begin <= sample.stamp_ns < end]
    found, extractor = segments_of(kept, trajectory)
    assert sorted(segment.film for segment in found) == [0, 1]
    assert extractor.lost_share(begin, end) > 0.9
    assert extractor.lost_share(START_NS, begin) < 0.05
    assert extractor.lost_share(START_NS - 10**9, START_NS) > 0.99


@pytest.mark.parametrize('rpm', [15.0, 60.0, 200.0])
def test_segments_do_not_depend_on_the_size_of_blocks(rpm):
    trajectory = steady(rpm)
    samples = films(trajectory, 0.5 + 3.0 * 60.0 / rpm, slip=0.1, total=0.13)
    whole, single, few = (segments_of(samples, trajectory, block)[0]
                          for block in (len(samples), 1, 37))
    spans = [np.array(sorted((segment.film, segment.begin_ns, segment.end_ns)
                             for segment in found)) for found in (whole, single, few)]
    assert len(spans[0]) == 6
    for other in spans[1:]:
        assert np.array_equal(other[:, 0], spans[0][:, 0])
        # the baseline is tracked per block: a millimeter or two of travel
        difference = np.max(np.abs(other[:, 1:] - spans[0][:, 1:]))
        assert difference <= PERIOD_NS + 0.002 / ROUND * 60e9 / rpm


def test_a_film_that_was_absent_is_segmented_again():
    trajectory = steady(60.0)
    samples = films(trajectory, 6.0)
    absent = [replace(sample, volts=(sample.volts[0], math.nan))
              if START_NS + 10**9 < sample.stamp_ns < START_NS + 2 * 10**9 else sample
              for sample in samples]
    found, _ = segments_of(absent, trajectory)
    assert sum(segment.film == 0 for segment in found) == 5
    assert sum(segment.film == 1 for segment in found) == 4


def test_a_baseline_that_differs_from_its_parameter_is_learned():
    trajectory = steady(60.0)
    samples = films(trajectory, 8.0)
    shifted = [replace(sample, volts=tuple(v + 0.3 for v in sample.volts)) for sample in samples]
    found, _ = segments_of(shifted, trajectory)
    late = [segment for segment in found if segment.begin_ns > START_NS + 4 * 10**9]
    assert len(late) >= 6
    assert all(abs(segment.baseline - 1.95) < 0.02 for segment in late)


def test_a_segment_contains_samples_from_before_entry_to_after_release():
    trajectory = steady(60.0)
    found, _ = segments_of(films(trajectory, 1.5), trajectory)
    positions = trajectory((found[0].instants - START_NS) * 1e-9)
    assert positions[-1] - positions[0] > CROSSING
    assert np.all(np.diff(found[0].instants) > 0)
    assert positions[-1] - positions[0] < 0.3 * ROUND


def filled(films, volts, stamps=None):
    buffer = FilmSampleBuffer(films, PERIOD_NS)
    stamps = [i * PERIOD_NS for i in range(len(volts))] if stamps is None else stamps
    for stamp, row in zip(stamps, volts):
        buffer.add(TireSample(int(stamp), 'front_right', row))
    return buffer


def test_samples_are_taken_once_and_up_to_an_instant():
    buffer = filled((0, 1), [(0.1 * i, 1.65) for i in range(10)])
    instants, volts = buffer.take(4 * PERIOD_NS)
    assert instants.tolist() == [i * PERIOD_NS for i in range(5)]
    assert volts[:, 0].tolist() == [0.1 * i for i in range(5)]
    assert len(buffer.take(20 * PERIOD_NS)[0]) == 5
    assert buffer.take(20 * PERIOD_NS)[1].shape == (0, 2)


def test_the_films_of_the_group_are_returned_and_absent_ones_are_nan():
    _, volts = filled((1, 2), [(0.0, 1.0, 2.0, 3.0)] * 3).take(PERIOD_NS)
    assert volts.tolist() == [[1.0, 2.0]] * 2
    _, volts = filled((0, 1), [(0.0, 1.0), (0.0,)]).take(PERIOD_NS)
    assert np.isnan(volts).tolist() == [[False, False], [False, True]]


def regularized(stamps):
    return filled((0,), [(1.65,)] * len(stamps), stamps).take(2**62)[0]


def test_timestamps_of_batches_become_as_regular_as_the_conversions():
    rng = np.random.default_rng(0)
    true = np.arange(4000) * 2_500_125  # 50 ppm slow
    received = true + np.repeat(rng.normal(0.0, 300_000.0, 250), 16).astype(np.int64)
    kept = np.ones(4000, bool)
    kept[1600:1648] = False
    regular = regularized(received[kept])
    error = (regular - true[kept])[1000:]
    assert np.std(error) < 120_000
    assert np.max(np.abs(np.diff(error))) < 10_000


def test_a_reset_of_the_node_is_followed_at_once():
    stamps = [i * PERIOD_NS for i in range(500)]
    for reset in (10**12, stamps[-1] - 10**8):
        assert regularized(sorted([*stamps, reset]))[-1] == max(reset, stamps[-1])
    assert regularized([*stamps, 10**12, 10**12 + PERIOD_NS])[-1] == 10**12 + PERIOD_NS


def test_a_reversal_is_detected_and_vibration_is_not():
    detector = ReversalDetector(0.003)
    time = np.arange(0.0, 4.0, 0.008)
    distance = np.where(time < 2.0, 0.2 * time, 0.8 - 0.2 * time)
    distance = distance + 0.001 * np.sin(40.0 * time)
    reversals = detector.follow((time * 1e9).astype(np.int64), distance)
    assert len(reversals) == 1
    assert reversals[0][0] == pytest.approx(2e9, abs=3e7)
    assert detector.direction == -1
