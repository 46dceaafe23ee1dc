# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Order of the identifications, use of former results, and refusals with their reasons."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from smart_tire.calibration import geometry, sequence
from smart_tire.calibration.recording import ImuRecord, Recording, WheelRecord
from smart_tire.calibration.sequence import calibrate, Inputs
from smart_tire.errors import EstimatorError
from smart_tire.parameters import RobotParams
from smart_tire.uncertain import Uncertain

ROBOT = RobotParams()
TIME = np.arange(0.0, 60.0, 0.0625)
BIAS = Uncertain(0.004, 0.001)


def recording(positions=True, vibration=0.0, speed=5.0, seconds=60.0):
    """Return a recording with rotating wheels; the fits of it are replaced."""
    rng = np.random.default_rng(1)
    imu = np.arange(0.0, seconds, 0.01)
    time = TIME[seconds > TIME]
    velocity = np.full((len(time), 4), speed)
    return Recording(
        ImuRecord(imu, 0.01 * rng.standard_normal((len(imu), 3)),
                  (0.05 + vibration) * rng.standard_normal((len(imu), 3))),
        WheelRecord(time, velocity, np.cumsum(velocity, axis=0) * 0.0625 if positions else None))


STATIC = SimpleNamespace(
    seconds=9.0, intervals=1, repeated_share=0.0, gyro_bias=[BIAS] * 3,
    roll=Uncertain(0.001, 0.01), pitch=Uncertain(0.0, 0.01),
    gyro_noise=Uncertain(0.0101, 0.0002), accel_noise=Uncertain(0.049, 0.0007))
STIFFNESS = SimpleNamespace(
    stiffness=Uncertain(50.0, 2.0), friction=Uncertain(0.5, 0.1), drag=Uncertain(1.6, 0.5),
    latency_error=Uncertain(-0.002, 0.001), slip=np.full(9, 0.1), force=np.ones(9))


class Fits:
    """Replacements of all fits that log their calls."""

    def __init__(self, monkeypatch):
        self.calls, self.stiffness, self.latency = [], STIFFNESS, Uncertain(0.02, 0.004)
        self.static = STATIC
        values = {
            'fit_jitter': lambda one, robot: self.log('jitter', robot, Uncertain(0.002, 1e-4)),
            'fit_yaw_rate': lambda one, robot: self.log(
                'latency', robot, SimpleNamespace(latency=self.latency)),
            'effective_track': lambda fits, radius: self.log(
                'track', None, Uncertain(0.57, 0.002)),
            'check_one_ground': lambda some, robot, sigma: None,
            'identify_stiffness': lambda some, robot, sigma: self.log(
                ('stiffness', sigma), robot, self.stiffness),
            'identify_motor': lambda some, lifted, robot: self.log(
                'motor', robot, SimpleNamespace(parameters=list, refused={
                    'torque constant': 'too few starts'}, notes=['one motor differs'])),
            'identify_icr': lambda one, robot: self.log('icr', robot, SimpleNamespace(
                parameters=lambda robot: [])),
            'combine_icr': lambda fits: fits[0]}
        for name, value in values.items():
            monkeypatch.setattr(sequence, name, value)
        monkeypatch.setattr(geometry, 'fit_rest',
                            lambda one, robot: self.log('rest', robot, self.static))

    def log(self, name, robot, result):
        self.calls.append((name, robot))
        return result

    @property
    def names(self):
        return [name if isinstance(name, str) else name[0] for name, _ in self.calls]

    def robot(self, wanted):
        return next(robot for name, robot in self.calls
                    if wanted == (name if isinstance(name, str) else name[0]))


@pytest.fixture
def fits(monkeypatch):
    return Fits(monkeypatch)


def everything():
    one = recording()
    return Inputs([one], [one], [one])


def test_each_identification_uses_the_results_of_the_former_ones(fits):
    found = calibrate(everything(), ROBOT)
    assert fits.names == ['rest', 'jitter', 'latency', 'track', 'stiffness', 'motor', 'icr']
    assert fits.robot('jitter').imu.accel_noise == 0.049
    assert fits.robot('latency').encoder.stamp_jitter == 0.002
    assert found.found['effective_track'].value == 0.57
    assert ('stiffness', 0.004) in [name for name, _ in fits.calls]
    assert fits.robot('stiffness').encoder.latency == 0.02
    assert fits.robot('motor').encoder.latency == pytest.approx(0.018)
    assert fits.robot('icr').tire.longitudinal_stiffness == 50.0
    latency = found.found['encoder.latency']
    assert latency.step == 'straight' and latency.sigma == pytest.approx(2.0 ** 0.5 * 1e-3)
    assert found.found['tire.longitudinal_stiffness_sigma'].value == pytest.approx(0.04)
    assert found.kept['motor.torque_constant'] == 'too few starts'
    assert found.notes == ['one motor differs']


def test_films_are_identified_last_with_the_identified_robot(fits):
    seen = []
    calibrate(everything(), ROBOT, lambda robot: seen.append(robot) or [])
    assert seen[0].tire.longitudinal_stiffness == 50.0


def test_without_recordings_all_values_are_kept_with_their_reasons():
    found = calibrate(Inputs(), ROBOT)
    assert not found.found and found.robot == ROBOT
    for name, reason in (
            ('imu.gyro_noise', 'no recording at rest'), ('encoder.latency', 'no recording'),
            ('tire.longitudinal_stiffness', 'no recording of straight starts and stops'),
            ('effective_track', 'no recording with turns'), ('icr_x', 'no recording with turns'),
            ('motor.torque_constant', 'no recording of straight'),
            ('wheel_radius', 'requires a pose reference'), ('imu.position', 'only its distance')):
        assert found.kept[name].startswith(reason)


def test_a_latency_with_a_large_standard_error_is_only_a_prior(fits):
    fits.latency = Uncertain(0.02, 0.016)
    found = calibrate(Inputs(turns=[recording()]), ROBOT)
    assert 'encoder.latency' not in found.found
    assert 'standard error of 0.016 s, expected at most 0.015' in found.kept['encoder.latency']


def test_latencies_of_turns_and_starts_that_contradict_refuse_the_stiffness(fits):
    fits.latency = Uncertain(0.04, 0.004)
    fits.stiffness = SimpleNamespace(**{**vars(STIFFNESS),
                                        'latency_error': Uncertain(-0.03, 0.001)})
    found = calibrate(everything(), ROBOT)
    assert 'tire.longitudinal_stiffness' not in found.found
    assert 'slip in one of them' in found.kept['tire.longitudinal_stiffness']
    assert found.found['encoder.latency'].step == 'turns'


def test_velocities_without_positions_give_no_latency(fits):
    one = recording(positions=False)
    found = calibrate(Inputs([one], [one], [one]), ROBOT)
    assert 'no positions' in found.kept['encoder.latency']
    assert found.robot.encoder.latency == ROBOT.encoder.latency


def test_a_robot_that_vibrates_keeps_the_noise_of_the_accelerometer(fits):
    one = recording(vibration=0.2)
    found = calibrate(Inputs([one], [one], [one]), ROBOT)
    assert 'in motion' in found.kept['imu.accel_noise']
    assert 'imu.gyro_noise' in found.found


def test_a_significant_tilt_is_written_with_its_standard_error(fits):
    fits.static = SimpleNamespace(**{**vars(STATIC), 'pitch': Uncertain(0.1, 0.01)})
    tilt = calibrate(Inputs([recording()]), ROBOT).found['imu.rotation']
    assert tilt.value == pytest.approx((0.001, 0.1, 0.0), abs=1e-3)
    assert tilt.sigma == (0.01, 0.01, 0.0)
    fits.static = STATIC
    kept = calibrate(Inputs([recording()]), ROBOT).kept['imu.rotation']
    assert 'below 3 standard errors' in kept


def test_turns_on_several_grounds_refuse_track_and_stiffness(fits, monkeypatch):
    def several(*_):
        raise EstimatorError('the turns give 0.57, 0.84 m: several grounds in one recording')
    monkeypatch.setattr(sequence, 'effective_track', several)
    found = calibrate(everything(), ROBOT)
    assert 'several grounds' in found.kept['effective_track']
    assert 'several grounds' in found.kept['tire.longitudinal_stiffness']
    assert 'stiffness' not in fits.names


@pytest.mark.parametrize('name, values, unit', [
    ('stiffness', ((50.0, 2.0), (62.0, 2.0)), 'C_x'), ('drag', ((1.6, 1.0), (17.0, 2.0)), 'drag')])
def test_parts_with_different_stiffness_or_drag_are_several_grounds(monkeypatch, name, values,
                                                                    unit):
    results = iter([SimpleNamespace(**{**vars(STIFFNESS), name: Uncertain(*value)})
                    for value in values])
    monkeypatch.setattr(sequence, 'identify_stiffness', lambda *_, **__: next(results))
    one = recording(speed=0.0)
    with pytest.raises(EstimatorError, match=f'{unit} .*several grounds'):
        sequence.check_one_ground([one], ROBOT, 0.01)


def test_equal_parts_and_parts_without_a_value_are_one_ground(monkeypatch):
    def refuse(*_, **__):
        raise EstimatorError('too short')
    for result in (lambda *_, **__: STIFFNESS, refuse):
        monkeypatch.setattr(sequence, 'identify_stiffness', result)
        sequence.check_one_ground([recording(speed=0.0)], ROBOT, 0.01)


def test_a_recording_is_divided_at_a_standstill_next_to_its_middle():
    one = recording()
    assert sequence.parts_of(one, ROBOT) == []  # never at rest
    velocity = one.wheels.velocity.copy()
    velocity[500:520] = 0.0  # 31.25 s
    stopped = replace(one, wheels=replace(one.wheels, velocity=velocity))
    first, second = sequence.parts_of(stopped, ROBOT)
    assert first.wheels.time[-1] == second.wheels.time[0] == 31.25
    assert first.imu.time[-1] <= 31.25 <= second.imu.time[0]
    assert len(first.imu.time) + len(second.imu.time) >= len(one.imu.time)
    assert sequence.parts_of(recording(speed=0.0, seconds=11.0), ROBOT) == []


def test_wheels_that_slide_while_straight_are_refused():
    critical = 3.0 * 0.5 * 0.25 * ROBOT.mass * 9.80665 / 50.0
    slip = np.full(10, 0.5 * critical)
    rolling = SimpleNamespace(**{**vars(STIFFNESS), 'slip': slip, 'force': np.ones(10)})
    sequence.check_rolling(rolling, ROBOT)
    slip[:4] = 1.1 * critical
    with pytest.raises(EstimatorError, match='slide in 40% of the motion'):
        sequence.check_rolling(rolling, ROBOT)
