# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The summary is plain JSON with estimates and errors."""

from dataclasses import replace
import json
import math

import numpy as np
import pytest

from smart_tire.analysis.metrics import Score
from smart_tire.analysis.result import Comparison
from smart_tire.analysis.summary import (
    divergence, error_tree, estimates_tree, plain, surfaces, WHOLE)
from smart_tire.recording import SampleArrays
from smart_tire.samples import Friction, GROUND_ESTIMATES, GroundState, Odometry, WheelSlip
from smart_tire.uncertain import Uncertain, UNKNOWN
from support.driving import driven

EPOCH = 1_700_000_000_000_000_000
SECOND = 1_000_000_000


def run(slip_error=0.0, mu_factor=1.0):
    """Return ten seconds of straight driving on surfaces with friction 0.47 and 0.3."""
    series = driven(1000, begin_ns=EPOCH, slip=0.1 + slip_error)
    for stamp_ns in range(EPOCH, EPOCH + SECOND, SECOND // 100):  # of equal ones the last counts
        series.add_sample(WheelSlip(stamp_ns, (math.nan,) * 4, (0.0,) * 4, (0.02,) * 4))
    for i in range(20):
        mu = (0.47 if i < 10 else 0.3) * mu_factor
        series.add_sample(Friction(EPOCH + i * SECOND // 2, 'front_left',
                                   friction_coefficient=Uncertain(mu, 0.05),
                                   friction_coefficient_single=Uncertain(mu, 0.05),
                                   slip=Uncertain(0.1, 0.0)))
    return series


def test_plain_values_are_json_types():
    tree = {'score': Score(1, math.nan, math.inf, np.float64(0.123456789), 1.0, 1.0),
            'list': (np.int64(3), None, 'text', np.array([1.0, math.nan]))}
    assert plain(tree) == {
        'score': {'count': 1, 'mean': None, 'rms': None, 'normalized_rms': 0.123457,
                  'within_one': 1.0, 'within_two': 1.0},
        'list': [3, None, 'text', [1.0, None]]}
    json.dumps(plain(tree), allow_nan=False)


def test_estimates_are_summarized_without_ground_truth():
    tree = estimates_tree(run())
    assert tree['odom']['distance_m'] == pytest.approx(5.0, abs=0.06)
    assert tree['odom']['end'] == {'x_m': pytest.approx(4.995), 'y_m': 0.0, 'yaw_rad': 0.0}
    assert tree['odom']['end_sigma']['x_m'] == pytest.approx(0.1)
    assert tree['wheel_slip']['left'] == {'mean': 0.1, 'mean_sigma': 0.02}
    assert tree['tire_friction'] == {'front_left': {
        'crossings': 20, 'informative': 20, 'median_single': pytest.approx(0.385),
        'last_fused': 0.3, 'last_fused_sigma': 0.05, 'last_fused_s': pytest.approx(EPOCH / 1e9)}}


def test_the_ground_is_summarized_by_medians():
    series = run()
    for i, stiffness in enumerate((50.0, 25.0, 26.0)):
        series.add_sample(GroundState(
            EPOCH + i, Uncertain(stiffness, 2.0), rolling_resistance=Uncertain(0.05, 0.01),
            friction_coefficient=Uncertain(0.5, 0.1) if i else UNKNOWN))
    ground = estimates_tree(series)['ground_state']
    assert ground.pop('messages') == 3 and len(ground.pop('grounds')) == 2
    assert tuple(ground) == GROUND_ESTIMATES
    assert ground['stiffness'] == {'median': 26.0, 'median_sigma': 2.0}
    assert ground['rolling_resistance'] == {'median': 0.05, 'median_sigma': 0.01}
    assert ground['friction_coefficient'] == {'median': 0.5, 'median_sigma': 0.1}
    assert ground['lateral_share'] == {'median': None, 'median_sigma': None}


def test_the_last_friction_is_the_last_one_that_is_known():
    series = run()
    for i in range(3):
        series.add_sample(Friction(EPOCH + (20 + i) * SECOND, 'front_left'))
        series.add_sample(Friction(EPOCH + i, 'rear_left'))
    friction = estimates_tree(series, EPOCH)['tire_friction']
    assert [friction['front_left'][name] for name in (
        'crossings', 'last_fused', 'last_fused_sigma', 'last_fused_s')] == [23, 0.3, 0.05, 9.5]
    assert friction['rear_left']['last_fused'] is friction['rear_left']['last_fused_s'] is None


def grounds(*values):
    """Return the times [s] of the grounds of states (C_x, mu, rolling resistance) at 2 Hz."""
    series = SampleArrays()
    for i, one in enumerate(values):
        series.add_sample(GroundState(EPOCH + i * SECOND // 2, *(
            UNKNOWN if math.isnan(value) else Uncertain(value, 0.1 * value) for value in one)))
    tree = estimates_tree(series, EPOCH)['ground_state']['grounds']
    return [(one['begin_s'], one['end_s'], one['stiffness']['median']) for one in tree]


def test_each_ground_is_summarized_on_its_own():
    firm, sand = (50.0, 0.5, 0.02), (25.0, 0.3, 0.15)
    assert grounds(*[firm] * 4, *[sand] * 6, *[firm] * 3) == [
        (0.0, 1.5, 50.0), (2.0, 4.5, 25.0), (5.0, 6.0, 50.0)]
    assert grounds(*[firm] * 4, sand, *[firm] * 4) == [(0.0, 4.0, 50.0)]  # a single state
    unknown = (50.0, math.nan, 0.02)
    assert grounds(*[unknown] * 3, *[firm] * 3) == [(0.0, 2.5, 50.0)]
    assert len(grounds(*[unknown] * 3, *[(50.0, math.nan, 0.15)] * 3)) == 2
    assert len(grounds(*[firm] * 3, *[(50.0, 0.7, 0.02)] * 3)) == 1  # 2.3 standard deviations
    assert len(grounds(*[(50.0, 0.5, 0.02 + 0.0005 * i) for i in range(60)])) == 1  # slowly


def test_without_estimates_the_tree_is_empty_and_without_truth_there_are_no_errors():
    assert estimates_tree(SampleArrays()) == {'tire_friction': {}}
    assert error_tree(Comparison(run(), SampleArrays())) is None


def test_errors_are_computed_for_the_available_ground_truth():
    truth = SampleArrays()
    truth.add_sample(Odometry(EPOCH, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0),
                              (0.0, 0.0, 0.0), (0.0,) * 36, (-1.0,) * 36))
    truth.add_sample(Odometry(
        EPOCH + SECOND, (0.5, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0),
        (0.0,) * 36, (-1.0,) * 36))
    tree = error_tree(Comparison(run(), truth))
    assert list(tree) == ['pose']
    assert tree['pose']['twist'] is None
    assert tree['pose']['position_end_m'] == pytest.approx(0.0, abs=1e-9)


def test_surfaces_are_distinguished_by_true_friction():
    intervals = surfaces(run().crossings)
    assert intervals == {'mu 0.47': [(EPOCH, EPOCH + 9 * SECOND // 2)],
                         'mu 0.30': [(EPOCH + 5 * SECOND, EPOCH + 19 * SECOND // 2)]}


def test_a_repeated_surface_has_two_intervals_and_a_single_one_no_name():
    crossings = run().crossings
    again = [replace(p, stamp_ns=p.stamp_ns + 20 * SECOND) for p in crossings]
    assert [len(found) for found in surfaces(crossings + again).values()] == [2, 2]
    assert surfaces(crossings[:10]) == {}


def test_errors_are_given_for_every_surface():
    tree = error_tree(Comparison(run(slip_error=0.02, mu_factor=1.1), run()))
    for name in (WHOLE, 'mu 0.47', 'mu 0.30'):
        assert tree['slip'][name]['left']['error']['mean'] == pytest.approx(0.02)
        assert tree['friction'][name]['traction']['median_relative_error'] == pytest.approx(0.1)
    assert tree['friction'][WHOLE]['traction']['crossings'] == 20
    assert tree['friction']['mu 0.30']['traction']['crossings'] == 10
    assert tree['friction']['false_crossings'] == 0
    assert tree['friction']['stamp'] == {'mean_s': 0.0, 'sigma_s': 0.0}


def test_given_intervals_replace_the_surfaces():
    tree = error_tree(Comparison(run(), run()), {'first': [(EPOCH, EPOCH + SECOND)]})
    assert list(tree['slip']) == [WHOLE, 'first']
    assert tree['friction']['first']['traction']['crossings'] == 3


def poses(speed, yaw_rate=0.5, variance=0.01, x=1.0, covariance=0.01):
    """Return odometry of two instants, the second with these values."""
    found = SampleArrays()
    for second, v in enumerate((1.0, speed)):
        found.add_sample(Odometry(
            EPOCH + second * SECOND, (x, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (v, 0.0, 0.0),
            (0.0, 0.0, yaw_rate), (covariance,) * 36, (variance,) * 36))
    return found


@pytest.mark.parametrize('found, wheel_speed', [
    (poses(3.1), 1.0), (poses(101.0), 90.0), (poses(-3.1), 1.0), (poses(1.0, variance=9.1), 1.0),
    (poses(1.0, 101.0), 1.0), (poses(1.0, x=float('inf')), 1.0),
    (poses(1.0, covariance=float('nan')), 1.0)])
def test_an_impossible_motion_is_divergence(found, wheel_speed):
    assert divergence(found, wheel_speed).startswith('the estimate diverges from ')


@pytest.mark.parametrize('found, wheel_speed', [
    (poses(2.9), 1.0), (poses(99.0), 90.0), (poses(1.9), 0.0), (SampleArrays(), 1.0)])
def test_a_fast_motion_is_no_divergence(found, wheel_speed):
    assert divergence(found, wheel_speed) == ''
    assert '1.0 s on: 2.1 m/s' in divergence(poses(2.1), 0.0)
