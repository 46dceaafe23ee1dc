# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Estimates as arrays: those of the offline analysis, to 1e-9."""

from __future__ import annotations

from dataclasses import replace
import sys

import numpy as np
import pytest
from smart_tire import (
    estimate, estimate_friction, estimate_slip, load_params, plot, read_bag, Recording, simulate,
    write_bag)
from smart_tire.analysis.offline import analyze
from smart_tire.analysis.pipeline import ESTIMATES
from smart_tire.api import Estimates, ImuData, WheelData
from smart_tire.bags import Bag
from smart_tire.errors import EstimatorError, ParameterError
from smart_tire.recording import SampleArrays
from smart_tire.samples import FRICTION_QUANTITIES, Odometry, WheelSlip
from support.arrays import assert_same_arrays


@pytest.fixture(scope='module')
def estimates(bag, params):
    """Return the estimates of the bag, which carries its parameters."""
    assert read_bag(bag).params.estimators == params.estimators != load_params().estimators
    return estimate(read_bag(bag))


@pytest.fixture(scope='module')
def analyzed(bag, params, tmp_path_factory):
    """Return the samples in the bag that the offline analysis writes."""
    out = tmp_path_factory.mktemp('analyzed') / 'out'
    analyze(bag, out, params.estimators)
    with Bag(out / 'estimates') as found:
        return [sample for _, _, sample in found.samples(ESTIMATES)]


def test_estimates_are_those_of_analyze(estimates, analyzed):
    found = SampleArrays(analyzed)
    assert_same_arrays(estimates, Estimates(found.poses(), found.slips(), found.centers(),
                                            found.grounds(), found.frictions()), 1e-9)
    assert len(estimates.friction) >= 3
    assert min(map(len, (estimates.pose, estimates.slip, estimates.center))) > 200


def test_columns_are_the_quantities_of_their_names(estimates, analyzed):
    slips = [sample for sample in analyzed if isinstance(sample, WheelSlip)]
    poses = [sample for sample in analyzed if isinstance(sample, Odometry)]
    np.testing.assert_allclose(estimates.slip.ratio, [one.ratio for one in slips])
    np.testing.assert_allclose(estimates.slip.sigma, [one.sigma for one in slips])
    np.testing.assert_allclose(estimates.slip.velocity, [one.slip_velocity for one in slips])
    np.testing.assert_allclose(estimates.pose.twist[:, :2], [one.linear[:2] for one in poses])
    np.testing.assert_allclose(estimates.pose.twist_sigma[:, 2] ** 2,
                               [one.twist_covariance[35] for one in poses])


def test_single_estimates_are_parts_of_all(recording, params, estimates):
    assert_same_arrays(estimate_slip(recording, params), estimates.slip, 0.0)
    assert_same_arrays(estimate_friction(recording, params), estimates.friction, 0.0)


def test_crossings_of_one_wheel(estimates):
    friction = estimates.friction
    left, right = friction.of('front_left'), friction.of('front_right')
    assert len(left) + len(right) == len(friction) and set(left.wheel) == {'front_left'}
    np.testing.assert_array_equal(
        left.normal_load.value, friction.normal_load.value[friction.wheel == 'front_left'])
    assert (np.diff(friction.stamp_ns) >= 0).all()


def test_a_data_frame_has_all_columns(estimates):
    frame = estimates.friction.to_pandas()
    assert frame.index.name == 'stamp_ns' and len(frame) == len(estimates.friction)
    assert list(frame.columns[:3]) == ['wheel', 'friction_coefficient',
                                       'friction_coefficient_sigma']
    assert frame.shape[1] == 1 + 2 * len(FRICTION_QUANTITIES)
    slip = estimates.slip.to_pandas()
    np.testing.assert_array_equal(slip['velocity.rear_left'], estimates.slip.velocity[:, 2])
    pose = estimates.pose.to_pandas()
    np.testing.assert_allclose(pose['y_sigma'] ** 2, estimates.pose.covariance[:, 1, 1])
    np.testing.assert_array_equal(pose['yaw_rate_sigma'], estimates.pose.twist_sigma[:, 2])
    assert list(estimates.center.to_pandas()) == ['x', 'y']
    assert list(estimates.ground.to_pandas())[1] == 'stiffness_sigma'


def test_measurements_as_data_frames(recording):
    assert list(recording.imu.to_pandas())[-1] == 'rate_z'
    assert list(recording.films['front_left'].to_pandas()) == ['film_1', 'film_2']
    assert recording.wheels.to_pandas().shape == (len(recording.wheels), 12)


def test_without_pandas_the_error_names_the_extra(estimates, monkeypatch):
    monkeypatch.setitem(sys.modules, 'pandas', None)
    with pytest.raises(ModuleNotFoundError, match=r'pip install smart_tire\[pandas\]'):
        estimates.slip.to_pandas()


def test_an_empty_recording_has_empty_estimates_of_the_right_shape():
    none = np.empty(0, np.int64)
    empty = estimate(Recording(ImuData(none, np.empty((0, 3)), np.empty((0, 3))),
                               WheelData(none, np.empty((0, 4)))))
    assert empty.pose.covariance.shape == (0, 3, 3) and empty.slip.ratio.shape == (0, 4)
    assert len(empty.friction) == 0 and empty.friction.slip.sigma.shape == (0,)


def test_a_plot_has_path_slip_and_friction_with_the_truth(recording, estimates):
    path, slip, friction = plot(estimates, recording.truth).axes
    assert path.get_xlabel() == 'x [m]' and path.get_aspect() == 1.0
    x, y = path.lines[0].get_data()
    assert [x[-1], y[-1]] == pytest.approx(estimates.pose.pose[-1, :2])
    assert [line.get_label() for line in slip.lines][:3] == [
        'left side ± 2σ', 'right side ± 2σ', 'truth']
    begin_ns = min(one.stamp_ns[0] for one in (estimates.pose, estimates.slip))
    found = np.concatenate([one.lines[0].get_xdata() for one in friction.containers])
    known = estimates.friction.stamp_ns[np.isfinite(estimates.friction.friction_coefficient.value)]
    assert sorted(found) == pytest.approx((np.sort(known) - begin_ns) / 1e9)
    assert slip.get_xlim() == friction.get_xlim()
    true = recording.truth.friction.friction_coefficient.value
    dashed = [line.get_ydata() for line in friction.lines if line.get_linestyle() == '--']
    assert {*np.concatenate(dashed).round(6)} == {*true.round(6)}
    mu = estimates.friction.friction_coefficient
    typical = np.nanmedian(mu.value), 2.0 * np.median(mu.sigma[np.isfinite(mu.sigma)])
    assert friction.get_ylim()[0] < typical[0] - typical[1] < sum(typical) < friction.get_ylim()[1]


def test_a_plot_without_truth_or_friction_has_fewer_lines_and_panels(estimates):
    slip_only = replace(estimates, friction=estimates.friction.of('rear_left'))
    assert len(plot(slip_only).axes) == 2 and len(plot(slip_only).axes[0].lines) == 1


def test_a_plot_of_nothing_is_an_error():
    none = np.empty(0, np.int64)
    empty = estimate(Recording(ImuData(none, np.empty((0, 3)), np.empty((0, 3))),
                               WheelData(none, np.empty((0, 4)))))
    with pytest.raises(EstimatorError, match='no estimates to plot'):
        plot(empty)


def test_parameters_come_from_files_and_values(tmp_path):
    file, other = tmp_path / 'a.yaml', tmp_path / 'b.yaml'
    file.write_text('/**: {ros__parameters: {wheel_radius: 0.1, mass: 20.0, seed: 4}}')
    other.write_text('/**: {ros__parameters: {mass: 30.0}}')
    params = load_params(file, other, values={'wheel_radius': 0.12, 'cmd_vel_timeout': 0.2})
    assert (params.robot.wheel_radius, params.robot.mass) == (0.12, 30.0)
    assert params.simulator.robot == params.robot == params.estimators.friction.robot
    assert params.simulator.seed == 4 and params.with_seed(5).simulator.seed == 5


@pytest.mark.parametrize(('values', 'message'), [
    ({'wheel_radios': 0.1}, 'did you mean wheel_radius'),
    ({'wheel_radius': -1.0}, 'parameter wheel_radius: -1.0, expected'),
])
def test_a_wrong_parameter_is_refused(values, message):
    with pytest.raises(ParameterError, match=message):
        load_params(values=values)


def test_the_estimates_of_a_bag_are_those_of_its_recording(recording, estimates, tmp_path):
    write_bag(tmp_path / 'bag', recording)
    for path in (tmp_path / 'bag', str(tmp_path)):
        found = estimate(path, recording.params)
        np.testing.assert_array_equal(found.slip.ratio, estimates.slip.ratio)


def test_a_ground_of_ones_own_is_that_everywhere():
    speeds = [(0.3, 12.0, 3.0)]
    given = simulate(speeds, 2.0, seed=1, ground={'friction': 0.2, 'stiffness': 80.0})
    params = load_params(values={
        'ground.names': ['other'], 'ground.base': 'other', 'ground.patches.names': [],
        'ground.friction': [0.2], 'ground.stiffness': [80.0], 'ground.drag': [0.015]})
    same = simulate(speeds, 2.0, seed=1, params=params)
    np.testing.assert_array_equal(given.truth.slip.ratio, same.truth.slip.ratio)
    rough = simulate(speeds, 2.0, seed=1, ground={'friction': 0.8, 'stiffness': 80.0})
    assert np.nanmax(given.truth.slip.ratio) > 1.1 * np.nanmax(rough.truth.slip.ratio)
    with pytest.raises(ParameterError, match='ground: mu, expected some of friction, stiffness'):
        simulate(speeds, 2.0, ground={'mu': 0.2})
