"""The summary is plain JSON that says what was estimated and how far it is from the truth."""

from dataclasses import replace
import json
import math

import numpy as np
import pytest

from smart_tire.analysis.metrics import Score
from smart_tire.analysis.series import Series
from smart_tire.analysis.summary import estimates_tree, plain, surfaces, truth_tree, WHOLE
from smart_tire.samples import Friction, Odometry, WheelSlip
from smart_tire.uncertain import Uncertain

EPOCH = 1_700_000_000_000_000_000
SECOND = 1_000_000_000
SPREAD = tuple(0.01 if i % 7 == 0 else 0.0 for i in range(36))


def run(slip_error=0.0, mu_factor=1.0):
    """Return ten seconds straight ahead, on a surface of 0.47 and then on one of 0.3."""
    series = Series()
    for i in range(1000):
        stamp = EPOCH + i * SECOND // 100
        series.add(Odometry(stamp, (0.005 * i, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.5, 0.0, 0.0),
                            (0.0, 0.0, 0.0), SPREAD, SPREAD))
        slip = math.nan if i < 100 else 0.1 + slip_error
        series.add(WheelSlip(stamp, (slip,) * 4, (0.0,) * 4, (0.02,) * 4))
    for i in range(20):
        mu = (0.47 if i < 10 else 0.3) * mu_factor
        series.add(Friction(EPOCH + i * SECOND // 2, 'front_left',
                            friction_coefficient=Uncertain(mu, 0.05),
                            friction_coefficient_single=Uncertain(mu, 0.05),
                            slip=Uncertain(0.1, 0.0)))
    return series


def test_plain_is_what_json_knows_and_nothing_more():
    tree = {'score': Score(1, math.nan, math.inf, np.float64(0.123456789), 1.0, 1.0),
            'list': (np.int64(3), None, 'text', np.array([1.0, math.nan]))}
    assert plain(tree) == {
        'score': {'count': 1, 'mean': None, 'rms': None, 'normalised_rms': 0.123457,
                  'within_one': 1.0, 'within_two': 1.0},
        'list': [3, None, 'text', [1.0, None]]}
    json.dumps(plain(tree), allow_nan=False)


def test_estimates_stand_by_themselves():
    tree = estimates_tree(run())
    assert tree['odom']['distance_m'] == pytest.approx(5.0, abs=0.06)
    assert tree['odom']['end'] == {'x_m': pytest.approx(4.995), 'y_m': 0.0, 'yaw_rad': 0.0}
    assert tree['odom']['end_sigma']['x_m'] == pytest.approx(0.1)
    assert tree['wheel_slip']['left'] == {'mean': 0.1, 'mean_sigma': 0.02}
    assert tree['tire_friction'] == {'front_left': {
        'passages': 20, 'telling': 20, 'median_single': pytest.approx(0.385),
        'last_fused': 0.3, 'last_fused_sigma': 0.05}}


def test_a_run_without_anything_estimated_has_an_empty_tree():
    assert estimates_tree(Series()) == {'tire_friction': {}}


def test_without_truth_there_is_no_comparison():
    assert truth_tree(run(), Series()) is None


def test_the_truth_is_compared_as_far_as_it_goes():
    truth = Series()
    truth.add(Odometry(EPOCH, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0),
                       (0.0, 0.0, 0.0), (0.0,) * 36, (-1.0,) * 36))
    truth.add(Odometry(EPOCH + SECOND, (0.5, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0),
                       (0.0, 0.0, 0.0), (0.0,) * 36, (-1.0,) * 36))
    tree = truth_tree(run(), truth)
    assert list(tree) == ['pose']
    assert tree['pose']['twist'] is None
    assert tree['pose']['position_end_m'] == pytest.approx(0.0, abs=1e-9)


def test_surfaces_are_told_apart_by_their_true_friction():
    spans = surfaces(run().passages)
    assert spans == {'mu 0.47': [(EPOCH, EPOCH + 9 * SECOND // 2)],
                     'mu 0.30': [(EPOCH + 5 * SECOND, EPOCH + 19 * SECOND // 2)]}


def test_a_surface_that_comes_back_has_two_stretches_and_a_single_one_needs_no_name():
    passages = run().passages
    again = [replace(p, stamp_ns=p.stamp_ns + 20 * SECOND) for p in passages]
    assert [len(stretches) for stretches in surfaces(passages + again).values()] == [2, 2]
    assert surfaces(passages[:10]) == {}


def test_every_surface_is_judged_by_itself():
    tree = truth_tree(run(slip_error=0.02, mu_factor=1.1), run())
    for name in (WHOLE, 'mu 0.47', 'mu 0.30'):
        assert tree['slip'][name]['left']['error']['mean'] == pytest.approx(0.02)
        assert tree['friction'][name]['traction']['median_relative_error'] == pytest.approx(0.1)
    assert tree['friction'][WHOLE]['traction']['passages'] == 20
    assert tree['friction']['mu 0.30']['traction']['passages'] == 10
    assert tree['friction']['false_passages'] == 0
    assert tree['friction']['stamp'] == {'mean_s': 0.0, 'sigma_s': 0.0}


def test_named_spans_take_the_place_of_the_surfaces():
    tree = truth_tree(run(), run(), {'first': [(EPOCH, EPOCH + SECOND)]})
    assert list(tree['slip']) == [WHOLE, 'first']
    assert tree['friction']['first']['traction']['passages'] == 3


def test_the_tree_is_valid_json():
    json.dumps(truth_tree(run(), run()), allow_nan=False)
    json.dumps(estimates_tree(run()), allow_nan=False)
