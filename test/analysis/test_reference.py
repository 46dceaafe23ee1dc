# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""References with covariances: ground truth over the overhead camera over none."""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np
import pytest
from smart_tire.analysis.errors import error_figure, error_groups, histogram_figure
from smart_tire.analysis.figure import CAMERA, TRUTH
from smart_tire.analysis.metrics import compared_poses, compared_slips, compared_twist, slip_scores
from smart_tire.analysis.motion_figures import (
    path_figure, slip_figure, velocity_figure, wheel_slip_figure)
from smart_tire.analysis.result import Result
from smart_tire.analysis.summary import evaluation, WHOLE
from smart_tire.analysis.tables import error_tables
from smart_tire.estimates import PoseEstimate, SlipEstimate
from smart_tire.recording import SampleArrays
from smart_tire.samples import NS_PER_S, Odometry, WheelSlip
from support.driving import driven
from support.ideal_robot import odometry

DRAWN = slip_figure, wheel_slip_figure, path_figure, velocity_figure


def truth():
    return driven(variance=0.0, sigma=0.0)


def camera(rate=20.0, **options):
    """Return four seconds at the rate of a camera, with standard deviations."""
    return driven(round(4 * rate), rate, **{'variance': 0.0016, 'sigma': 0.03, **options})


def labels(figure):
    return {mark.label for panel in figure.panels for mark in panel.marks}


def test_truth_is_the_reference_before_the_camera_and_the_camera_before_none():
    own = driven()
    for given, name in (({'truth': truth(), 'camera': camera()}, TRUTH),
                        ({'camera': camera()}, CAMERA), ({}, None)):
        tree = evaluation(Result(own, **given).filtered)
        assert list(tree) == ['estimates', 'against_truth', 'against_camera']
        assert {key for key in tree if key.startswith('against') and tree[key]} == (
            {f'against_{name}'} if name else set())


def test_with_truth_the_errors_do_not_depend_on_the_camera():
    both, alone = (evaluation(Result(driven(), truth=truth(), camera=one).filtered)
                   for one in (camera(speed=0.7, slip=0.4), SampleArrays()))
    assert both == alone


def test_the_smoothed_estimates_are_compared_with_the_camera_too():
    found = Result(driven(), smoothed=driven(speed=0.6), camera=camera()).comparisons
    assert [one.name for one in found.values()] == [CAMERA, CAMERA]
    assert evaluation(found['smoothed'])['against_camera']['pose']['twist']['v_x']['mean'] == (
        pytest.approx(0.1))


def test_errors_are_normalized_by_the_sigmas_of_both():
    found = evaluation(Result(driven(speed=0.6, slip=0.2, sigma=0.04, variance=0.0009),
                              camera=camera()).filtered)['against_camera']
    slip = found['slip'][WHOLE]['front_left']['error']
    assert slip['rms'] == pytest.approx(0.1) and slip['normalized_rms'] == pytest.approx(2.0)
    twist = found['pose']['twist']
    assert twist['v_x']['normalized_rms'] == pytest.approx(2.0)
    assert found['slip'][WHOLE]['left']['error']['normalized_rms'] == pytest.approx(2.0)


def series(pose, covariance):
    count = len(pose)
    stamps = np.arange(count) * NS_PER_S // 10
    return PoseEstimate(stamps, pose, np.zeros((count, 3)), covariance, np.zeros((count, 3)))


def test_the_covariance_of_an_aligned_path_is_that_of_its_scatter():
    rng = np.random.default_rng(5)
    angle = np.linspace(0.0, 2.0, 40)
    own = np.column_stack([2.0 * np.sin(angle), 1.0 - np.cos(angle), angle])
    turn, shift = 2.2, np.array([3.0, -1.0])  # of odom in map
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    seen = np.column_stack([own[:, :2] @ rotation.T + shift, own[:, 2] + turn])
    root = np.array([[4e-3, 0.0, 0.0], [3e-3, 1e-3, 0.0], [1e-3, -1e-3, 2e-3]])
    covariance = np.broadcast_to(root @ root.T, (40, 3, 3))
    exact = series(own, np.zeros((40, 3, 3)))
    errors = []
    for _ in range(3000):
        noisy = seen.copy()
        noisy[[0, 20]] += rng.standard_normal((2, 3)) @ root.T
        found = compared_poses(exact, series(noisy, covariance))
        errors.append(found.error[20])
    scatter, stated = np.cov(np.transpose(errors)), found.covariance[20]
    factor = np.linalg.cholesky(stated)
    whitened = np.linalg.solve(factor, np.linalg.solve(factor, scatter).T)
    assert whitened == pytest.approx(np.eye(3), abs=0.12)
    assert np.mean(errors, axis=0) == pytest.approx(np.zeros(3), abs=0.003)


def test_a_covariance_that_is_not_given_counts_as_zero():
    own, other = (driven(variance=0.01, sigma=0.02) for _ in range(2))
    unknown = SampleArrays()
    for stamp_ns in other.poses().stamp_ns.tolist():
        unknown.add_sample(Odometry(
            stamp_ns, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.0,) * 3, (0.0,) * 3,
            (-1.0, *(0.0,) * 35), (-1.0, *(0.0,) * 35)))
    found = compared_poses(own.poses(), unknown.poses())
    assert found.sigma == pytest.approx(0.1)
    assert not len(compared_twist(own.poses(), unknown.poses()).stamp_ns)


def slips(ratio, sigma):
    count = len(ratio)
    ratio, sigma = (np.repeat(np.array(values)[:, None], 4, 1) for values in (ratio, sigma))
    return SlipEstimate(np.arange(count) * NS_PER_S // 20, ratio, sigma, ratio)


@pytest.mark.parametrize('ratio, sigma', [(math.nan, 1.0), (-0.9, 0.51)])
def test_slip_that_the_camera_does_not_observe_is_not_compared(ratio, sigma):
    own = slips([0.1] * 10, [0.01] * 10)
    reference = slips([0.1] * 6 + [ratio] * 4, [0.02] * 6 + [sigma] * 4)
    found = slip_scores(compared_slips(own, reference))['rear_right'].error
    assert (found.count, found.rms) == (6, pytest.approx(0.0, abs=1e-9))
    assert np.isnan(compared_slips(own, reference).error[6:]).all()


def test_standstill_of_the_estimates_is_not_compared_with_a_moving_camera():
    # the first moving estimate is interpolated from one that has no slip
    own, reference = slips([math.nan] * 5 + [0.1] * 5, [1.0] * 5 + [0.01] * 5), slips(
        [0.2] * 10, [0.02] * 10)
    assert slip_scores(compared_slips(own, reference))['left'].error.count == 4


def with_gap(first, last):
    """Return what the camera sees but from ``first`` to ``last`` [s]."""
    found = SampleArrays()
    for i in range(80):
        if not first < i / 20 < last:
            stamp_ns = round(i / 20 * NS_PER_S)
            found.add_sample(odometry(stamp_ns, 0.025 * i, v_x=0.5, variance=1e-6))
            found.add_sample(WheelSlip(stamp_ns, (0.1,) * 4, (0.0,) * 4, (0.02,) * 4))
    return found


def test_gaps_of_the_camera_are_not_filled():
    result = Result(driven(), camera=with_gap(1.0, 2.5))
    found = evaluation(result.filtered)['against_camera']
    assert found['slip'][WHOLE]['left']['error']['count'] == 80 - 29
    assert found['pose']['duration_s'] == pytest.approx(3.95)
    for draw in DRAWN:
        (mark, *_) = [mark for panel in draw(result).panels for mark in panel.marks
                      if mark.label.startswith(CAMERA)]
        assert np.isnan(mark.curve.y).sum() == 1, draw.__name__
    (path,) = [mark for mark in path_figure(result).panels[0].marks if mark.label == CAMERA]
    (gap,) = np.flatnonzero(np.isnan(path.curve.x))
    assert path.curve.x[[gap - 1, gap + 1]] == pytest.approx([0.5, 1.25])


def test_the_camera_is_a_third_line_with_its_own_band():
    both = Result(driven(), truth=truth(), camera=camera())
    for draw in DRAWN:
        figure, alone = draw(both), draw(replace(both, truth=SampleArrays()))
        own = CAMERA if draw is path_figure else f'{CAMERA} ± 2σ'
        assert {TRUTH, own} <= labels(figure), draw.__name__
        assert own in labels(alone) and TRUTH not in labels(alone), draw.__name__
        assert 'the overhead camera' in figure.caption and 'ground truth' in figure.caption
        assert 'ground truth' not in alone.caption
        assert 'the overhead camera' not in draw(replace(both, camera=SampleArrays())).caption
    marks = [mark for mark in velocity_figure(both).panels[0].marks if mark.label]
    assert [mark.color for mark in marks] == ['blue', 'green', 'ink']
    assert marks[1].curve.sigma == pytest.approx(0.04) and marks[2].curve.sigma is None


def test_tables_and_errors_name_the_camera():
    result = Result(driven(), camera=camera())
    tables = error_tables(evaluation(result.filtered))
    assert tables[0].title == 'Errors of the path; camera aligned at the start'
    assert 'mean camera' in tables[-1].head
    groups = error_groups(result.filtered)
    for figure in (error_figure('a', 'A', groups['slip'], CAMERA),
                   histogram_figure(groups, CAMERA)):
        assert 'camera' in figure.caption and 'truth' not in figure.caption
