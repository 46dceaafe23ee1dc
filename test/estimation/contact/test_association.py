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

"""Association of film detections with predicted patch crossings."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.contact.association import CrossingAssociator, POSITION_GATE
from smart_tire.estimation.contact.film_group import FilmGroup
from smart_tire.estimation.contact.prediction import PredictedCrossing
from smart_tire.estimation.contact.records import Detection, FilmCrossing
from smart_tire.estimation.contact.segmentation import ActiveSegment
from smart_tire.parameters import RobotParams

GROUP = FilmGroup.of(RobotParams(), 'front_right', (0, 1))
CIRCUMFERENCE = 0.5466
POSITION = 0.3  # m, of the films' common center
PREDICTED = PredictedCrossing(POSITION, 1, 10)


def film_crossing(film, *, error=0.0, direction=1, coverage=1.0, begin_ns=5):
    segment = ActiveSegment(film, begin_ns, begin_ns + 1, np.empty(0, np.int64), np.empty(0), 1.65)
    return FilmCrossing(POSITION + GROUP.offsets[film] + error, begin_ns, direction, 0.27,
                        Detection(0.0, 0.8, 0.1, 0.15, coverage), segment)


def associator(*crossings):
    found = CrossingAssociator(GROUP, CIRCUMFERENCE)
    for crossing in crossings:
        found.add(crossing, [(0, 0.0)])
    return found


def test_detections_near_the_predicted_position_are_associated():
    first, second = film_crossing(0), film_crossing(1, error=0.5 * POSITION_GATE)
    both = associator(first, second)
    assert both.detections(PREDICTED) == {0: first, 1: second}
    assert both.complete(PREDICTED)


@pytest.mark.parametrize('change', [{'error': 1.1 * POSITION_GATE}, {'direction': -1}])
def test_detections_elsewhere_or_in_the_other_direction_are_not_associated(change):
    assert associator(film_crossing(0, **change)).detections(PREDICTED) == {}


def test_of_several_detections_the_one_with_the_best_coverage_is_used():
    best = film_crossing(0, coverage=0.9)
    several = associator(film_crossing(0, coverage=0.5), best, film_crossing(0, coverage=0.4))
    assert several.detections(PREDICTED) == {0: best}


def test_taken_and_dropped_detections_are_not_associated_again():
    both = associator(film_crossing(0, begin_ns=5), film_crossing(1, begin_ns=8))
    both.drop_before(6)
    assert set(both.take(PREDICTED)) == {1}
    assert both.detections(PREDICTED) == {}


def test_predicted_crossings_are_released_once():
    both = associator(film_crossing(0), film_crossing(1))
    both.predict([(20, 0.0), (30, 0.5)])
    released = both.release(lambda predicted: True)
    assert [predicted.direction for predicted in released] == [1]
    assert released[0].position == pytest.approx(POSITION)
    assert list(both.pending) == []
