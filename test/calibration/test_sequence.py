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

from types import SimpleNamespace

import numpy as np
import pytest
from smart_tire.calibration import geometry, sensor_noise, sequence
from smart_tire.calibration.ground_fit import SCALE
from smart_tire.calibration.recording import CalibrationRecording, ImuRecord, WheelRecord
from smart_tire.calibration.sequence import calibrate, Inputs
from smart_tire.errors import EstimatorError
from smart_tire.estimation.ground.unknowns import Unknown
from smart_tire.parameters import build, RobotParams
from smart_tire.parameters.calibration_file import Identified
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
    return CalibrationRecording(
        ImuRecord(imu, 0.01 * rng.standard_normal((len(imu), 3)),
                  (0.05 + vibration) * rng.standard_normal((len(imu), 3))),
        WheelRecord(time, velocity, np.cumsum(velocity, axis=0) * 0.0625 if positions else None))


STATIC = SimpleNamespace(
    seconds=9.0, intervals=1, repeated_share=0.0, gyro_bias=[BIAS] * 3,
    roll=Uncertain(0.001, 0.01), pitch=Uncertain(0.0, 0.01),
    gyro_noise=Uncertain(0.0101, 0.0002), accel_noise=Uncertain(0.049, 0.0007))
LATENCY = Uncertain(0.018, 0.001)  # s, of the fit of all motion


class Fits:
    """Replacements of all fits that log their calls."""

    def __init__(self, monkeypatch):
        self.calls, self.late, self.latency = [], LATENCY, Uncertain(0.02, 0.004)
        self.static, self.torques_used = STATIC, False
        self.unknowns = {}  # row -> estimate
        values = {
            'fit_yaw_rate': lambda one, robot: self.log(
                'latency', robot, SimpleNamespace(latency=self.latency)),
            'effective_track': lambda fits, radius: self.log(
                'track', None, Uncertain(0.57, 0.002)),
            'fit_ground': lambda some, robot, *, torques: self.log(
                ('torques' if torques else 'ground', len(some)), robot, SimpleNamespace(
                    latency=self.late, estimate=lambda row: self.unknowns.get(
                        row, Uncertain(0.0, 1e-6)))),
            'stiffness_of': lambda fit: SimpleNamespace(parameters=lambda: [
                Identified('tire.longitudinal_stiffness', 50.0, 2.0),
                Identified('tire.longitudinal_stiffness_sigma', 0.04)]),
            'identify_motor': lambda some, lifted, robot, scale: self.log(
                ('motor', scale), robot, SimpleNamespace(parameters=list, refused={
                    'torque constant': 'too few starts'}, notes=['one motor differs'],
                    torques_used=self.torques_used)),
            'identify_icr': lambda one, robot: self.log('icr', robot, SimpleNamespace(
                parameters=lambda robot: [])),
            'combine_icr': lambda fits: fits[0]}
        for name, value in values.items():
            monkeypatch.setattr(sequence, name, value)
        monkeypatch.setattr(sensor_noise, 'fit_jitter', lambda one, robot: self.log(
            'jitter', robot, Uncertain(0.002, 1e-4)))
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


def test_the_jitter_is_that_of_turns_or_else_of_straight_motion(fits, monkeypatch):
    def jitter(wheels, robot):
        if wheels.position is None:
            raise EstimatorError('no positions')
        return Uncertain(0.003, 1e-4)

    monkeypatch.setattr(sensor_noise, 'fit_jitter', jitter)
    good, bad, name = recording(), recording(positions=False), 'encoder.stamp_jitter'
    for turns, straight, step in (([bad, good], [bad], 'turns'), ([bad], [bad, good], 'straight')):
        found = calibrate(Inputs((), straight, turns), ROBOT).found[name]
        assert (found.value, found.step) == (0.003, step)
    for turns, reason in (([bad], 'no positions'), ([], 'no recording in motion')):
        assert calibrate(Inputs((), turns, turns), ROBOT).kept[name] == reason


def test_each_identification_uses_the_results_of_the_former_ones(fits):
    found = calibrate(everything(), ROBOT)
    assert fits.names == ['rest', 'jitter', 'latency', 'track', 'ground', 'motor', 'icr']
    assert fits.robot('jitter').imu.accel_noise == 0.049
    assert fits.robot('latency').encoder.stamp_jitter == 0.002
    assert found.found['effective_track'].value == 0.57
    assert ('ground', 1) in [name for name, _ in fits.calls]  # the same recording counts once
    assert fits.robot('ground').encoder.latency == 0.02
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
            ('wheel_radius', 'requires a pose reference'), ('imu.position', 'given')):
        assert found.kept[name].startswith(reason)


def test_a_latency_with_a_large_standard_error_is_only_a_prior(fits):
    fits.latency = Uncertain(0.02, 0.016)
    found = calibrate(Inputs(turns=[recording()]), ROBOT)
    assert 'encoder.latency' not in found.found
    assert 'standard error of 0.016 s, expected at most 0.015' in found.kept['encoder.latency']


def test_latencies_of_turns_and_starts_that_contradict_refuse_the_stiffness(fits):
    fits.latency = Uncertain(0.04, 0.004)
    fits.late = Uncertain(0.01, 0.001)
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
    assert 'ground' not in fits.names


def test_the_motors_get_the_scale_of_the_accelerometer(fits):
    fits.unknowns[SCALE] = Uncertain(0.04, 0.012)
    calibrate(everything(), ROBOT)
    scale = next(name[1] for name, _ in fits.calls if name[0] == 'motor')
    assert scale == pytest.approx((1.04, 0.013))


def test_torques_refine_the_stiffness_if_they_are_those_of_the_motors(fits):
    fits.torques_used = True
    robot = build(RobotParams, {'imu.position_sigma': 0.05})
    fits.unknowns.update({Unknown.IMU_X: Uncertain(0.01, 0.004),
                          Unknown.IMU_Y: Uncertain(-0.02, 0.003)})
    found = calibrate(everything(), robot)
    assert fits.names[-3:] == ['motor', 'torques', 'icr']
    # both fits begin with what was known before: nothing counts twice
    assert fits.robot('torques').imu.position == robot.imu.position
    assert fits.robot('torques').imu.position_sigma == 0.05
    assert found.found['imu.position'].value == pytest.approx((0.06, 0.0, 0.1))
    assert found.found['imu.position'].sigma == (0.004, 0.003, 0.0)
    assert fits.robot('icr').imu.position_sigma == found.robot.imu.position_sigma == 0.004


def test_a_position_of_the_imu_that_was_given_or_is_not_determined_is_kept(fits):
    assert 'given' in calibrate(everything(), ROBOT).kept['imu.position']
    fits.calls.clear()
    fits.unknowns.update({Unknown.IMU_X: Uncertain(0.01, 0.03),
                          Unknown.IMU_Y: Uncertain(0.0, 0.003)})
    robot = build(RobotParams, {'imu.position_sigma': 0.05})
    found = calibrate(everything(), robot)
    assert 'turns' in found.kept['imu.position']
    assert found.robot.imu.position == robot.imu.position
    assert fits.robot('icr').imu.position_sigma == 0.05


def test_torques_that_contradict_the_fit_are_left_out_with_a_note(fits, monkeypatch):
    fits.torques_used, ground = True, sequence.fit_ground

    def refused(some, robot, *, torques):
        if torques:
            raise EstimatorError('does not converge')
        return ground(some, robot, torques=torques)
    monkeypatch.setattr(sequence, 'fit_ground', refused)
    found = calibrate(everything(), ROBOT)
    assert found.found['tire.longitudinal_stiffness'].value == 50.0
    assert any('without the motor torques: does not converge' in note for note in found.notes)
