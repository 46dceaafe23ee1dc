# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Errors over time: differences, standard deviations and which values count."""

import math

import numpy as np
import pytest

from smart_tire.analysis.errors import error_groups, ErrorCurve
from smart_tire.analysis.figure import Curve
from smart_tire.analysis.result import Comparison
from smart_tire.recording import SampleArrays
from smart_tire.samples import Friction, NS_PER_S
from smart_tire.uncertain import Uncertain
from support.driving import driven


def drive(speed, **options):
    """Return two seconds of straight driving at ``speed`` [m/s]."""
    return driven(20, 10.0, speed=speed, **{'variance': 0.04, **options})


def errors(own, truth):
    return error_groups(Comparison(own, truth))


def test_pose_errors_grow_along_the_path_and_keep_the_standard_deviations():
    x, y, heading = errors(drive(1.1), drive(1.0, variance=0.0))['pose']
    assert (x.name, x.unit, heading.unit) == ('x', 'm', 'rad')
    assert x.curve.y == pytest.approx(0.1 * x.curve.x)
    assert y.curve.y == pytest.approx(0.0) and heading.curve.y == pytest.approx(0.0)
    assert x.curve.sigma == pytest.approx(0.2)
    assert x.score.count == 20 and x.score.within_one == 1.0
    assert x.normalized == pytest.approx(0.5 * x.curve.x)


def test_errors_need_an_overlap_and_a_true_twist():
    assert errors(drive(1.1), drive(1.0))['velocity'][0].curve.y == pytest.approx(0.1)
    assert errors(drive(1.1), drive(1.0, twist=False))['velocity'] == []
    assert not any(errors(drive(1.0), SampleArrays()).values())


def test_slip_errors_count_where_slip_is_observable():
    found = errors(drive(1.0, slip=0.2), drive(1.0, slip=0.1))['slip']
    assert [one.name for one in found] == [
        'slip front left', 'slip front right', 'slip rear left', 'slip rear right']
    assert found[0].score.mean == pytest.approx(0.1)
    unknown = errors(drive(1.0, slip=1.0, sigma=0.6), drive(1.0))['slip']
    assert unknown[0].score.count == 0 and not len(unknown[0].normalized)


def test_uninformative_single_crossings_do_not_count():
    truth, own = SampleArrays(), SampleArrays()
    truth.crossings = [
        Friction(i * NS_PER_S, 'front_left', friction_coefficient=Uncertain(0.5, 0.0),
                 friction_coefficient_single=Uncertain(0.5, 0.0)) for i in range(3)]
    own.crossings = [
        Friction(i * NS_PER_S, 'front_left', friction_coefficient=Uncertain(0.6, 0.1),
                 friction_coefficient_single=Uncertain(0.7, sigma))
        for i, sigma in enumerate((0.1, 0.9))]
    single, fused = errors(own, truth)['friction']
    assert (single.score.count, fused.score.count) == (1, 2)
    assert single.curve.y[0] == pytest.approx(0.2)
    assert fused.normalized == pytest.approx([1.0, 1.0])
    assert errors(SampleArrays(), truth)['friction'] == []


def test_errors_without_standard_deviation_are_not_normalized():
    curve = Curve(np.arange(3.0), np.array([1.0, math.nan, 2.0]), np.array([0.0, 1.0, 4.0]))
    assert ErrorCurve('x', 'm', curve).normalized.tolist() == [0.5]
