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

"""What was left out: late and rejected messages, unknown slip, uninformative crossings."""

import math

from smart_tire.analysis.html_report.left_out import left_out_table, skipped_lines
from smart_tire.analysis.offline import Analysis, BagContents
from smart_tire.samples import Friction, WheelSlip
from smart_tire.uncertain import Uncertain, UNKNOWN

INPUTS = {'imu/data': {'late': 0, 'rejected': 3}, 'tire_samples': {'late': 7, 'rejected': 0}}


def estimated():
    """Return slips of which a quarter is undefined and a quarter unknown, and three crossings."""
    analysis = Analysis()
    for i, (ratio, sigma) in enumerate(((0.1, 0.5), (0.1, 0.1), (math.nan, 1.0), (1.0, 0.6))):
        analysis.estimates.add(WheelSlip(i, (ratio,) * 4, (0.0,) * 4, (sigma,) * 4))
    analysis.estimates.crossings = [
        Friction(i, 'front_left', friction_coefficient_single=single)
        for i, single in enumerate((Uncertain(0.5, 0.1), Uncertain(0.5, 0.4), UNKNOWN))]
    return analysis


def test_every_kind_is_counted_with_its_reason():
    rows = left_out_table(estimated(), INPUTS).rows
    assert [(row[0], row[1].split(':')[0], row[2]) for row in rows] == [
        ('imu/data', 'rejected', '3'), ('tire_samples', 'late', '7'),
        ('slip ratios of wheels', 'standstill', '4 (25%)'),
        ('slip ratios of wheels', 'σ above 0.5', '4 (25%)'),
        ('single crossings of front left', 'friction not observable, such as at low slip',
         '1 of 3'),
        ('single crossings of front left', 'uninformative', '1 of 3')]


def test_nothing_left_out_is_an_empty_table():
    assert left_out_table(Analysis(), {'odom': {'late': 0, 'rejected': 0}}).rows == []


def test_warnings_of_the_reader_are_not_listed_twice():
    contents = BagContents(skipped=['a is not in the bag', 'file is truncated'],
                           warnings=['file is truncated'])
    assert skipped_lines(contents) == ['a is not in the bag']
