# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Regressions of the motors: duty against speed, torque against duty, lifted wheels, and the ground.

With kappa, the measured torque over the true one, the sum over the wheels on the ground is
``kappa (r m f + J sum(dw/dt)) + resistance + offset``: the body is the weight that calibrates the
torque constant. The specific force f contains the slope of the ground. Wheels off the ground give
kappa J, and kappa times the friction of gear and bearings, of each motor. On the ground alone the
inertia of the wheels acts like mass, and their friction like rolling resistance.

Between two commands the torque of a motor falls while the wheel accelerates. Readings at the rate
of the commands see it always at the same phase: in acceleration their mean is wrong by up to 20 %
for the paper's robot at 16 Hz. The duty is known at all times, and the torque of a brushed motor
is ``tau = k (duty - w / w_0)``, with the stall torque k and the free speed w_0. First w_0 follows
from means over windows, in which acceleration, force and friction stand for the torque. Then k, in
the unit of the measured torque, follows from torque, duty and speed at the same instants.

What the recordings do not determine is assumed, with a standard deviation: all fits are repeated
with another assumption, and the change is a part of the standard error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.motor_rows import COMMAND_DELAY, MotorRows
from smart_tire.calibration.results import CONFIGURED_SIGMA, MIN_ROWS
from smart_tire.errors import EstimatorError
from smart_tire.numerics.least_squares import Errors, Fit, HAC_TIME, Prior, regression, Rows
from smart_tire.parameters import RobotParams
from smart_tire.samples import GRAVITY, LEFT, RIGHT
from smart_tire.uncertain import Uncertain, weighted_mean

Runs = Sequence[MotorRows]

MAX_TURN_SHARE = 0.2     # of the speed: half the difference of the sides; tires scrub in turns
VISCOUS_SHARE = 0.05     # of r m g / 4: sigma of viscous friction at the largest speed; assumed
OFFSET_SHARE = 0.01      # of r m g / 4: sigma of the offset of a measured torque; assumed
TORQUE_DELAY_SIGMA = 0.01  # s, of the measured torque against the IMU; assumed
READING_DELAY = 0.002    # s from the encoders to the currents: boards are read in turn; assumed
SLIP_SHARE, DELAY_SIGMA = 0.2, 0.002  # -, s, sigma of the slip in a speed and of delays; assumed
ACCEL_SCALE_SIGMA = 0.005   # relative, of the accelerometer; data sheets of MEMS sensors
SAMPLED_SIGMA = 0.04     # relative, of an inertia without motor_commands: 16 Hz of 50 Hz
SAMPLED_TORQUE_SHARE = 0.2  # of the torque that accelerates a wheel, in one window
SAMPLING_FACTOR = 2.0    # error of the torque over the ripple of the force, which tires smooth
MIN_SPEED_CHANGES = 0.3  # m/s2, rms of the specific force: smaller ones calibrate nothing
MIN_FOLLOWED_ACCELERATION = 0.2  # m/s2 rms of the wheels, to compare them with the body
MIN_FOLLOWING, MAX_FOLLOWING = 0.5, 0.3  # body over wheels: on the ground, and lifted
BRAKING_FACTOR, MIN_BRAKING_ROWS = 2.0, 10  # times the configured friction: motors must brake, too
KAPPA, GROUND_VISCOUS, GROUND_DELAY = range(3)  # values of the ground; resistance, offset follow
INERTIA, COULOMB, VISCOUS = range(3)            # values of a lifted wheel; offsets follow


@dataclass(frozen=True)
class Drive:
    """Relation of duty, speed and measured torque of each motor."""

    stall_torque: Array    # (4,) N m at full duty, in the unit of the measured torque
    offset: Array          # (4,) N m, of the measured torque
    speed_gain: Array      # (4,) s/rad, duty per speed: 1 / free speed
    relative_sigma: float  # of the common factor of the stall torques, from noise
    viscous_sigma: float   # N m s/rad, of the torque over speed, from ``speed_gain``

    def replaced(self, rows: MotorRows, delay_error: float) -> MotorRows:
        """Return rows with the torque by the duty, whose delay is wrong by ``delay_error`` [s]."""
        duty = rows.duty - (COMMAND_DELAY + delay_error) * rows.duty_rate
        return replace(
            rows, torque=self.offset + self.stall_torque * (duty - self.speed_gain * rows.speed),
            torque_sigma=self.stall_torque * self.speed_gain * rows.speed_sigma)


@dataclass(frozen=True)
class LiftedFit:
    """Means over the motors, in the unit of the measured torque, and each motor's inertia."""

    means: tuple[Uncertain, Uncertain, Uncertain]  # inertia, Coulomb and viscous friction, in SI
    inertias: list[Uncertain]   # kg m2, of each motor
    max_speed: float            # rad/s


@dataclass(frozen=True)
class GroundFit:
    """The force balance of the robot on the ground."""

    kappa: Uncertain        # measured over true torque
    resistance: Uncertain   # N m per wheel at low speed, as measured
    scales: list[Uncertain]  # kappa of each motor, if all tires push equally
    balance: Array          # (n,) N m, torque of all wheels that force and inertia require
    torque: Array           # (n,) N m, as measured, without resistance and offset


@dataclass(frozen=True)
class Assumptions:
    """Errors of what is assumed."""

    slip: float = 0.0           # relative, in the speed at an instant
    command_delay: float = 0.0  # s
    reading_delay: float = 0.0  # s
    inertia: float = 0.0        # standard errors


@dataclass(frozen=True)
class Solution:
    """All fits; without ``drive`` the torque is that of its readings."""

    drive: Drive | None
    lifted: LiftedFit | None
    ground: GroundFit
    kappa: Uncertain          # with all sources of error
    inertia_shift: float      # of kappa, for an inertia larger by its sigma
    shifts: tuple[float, ...]  # of the means of the lifted wheels, by the assumptions
    sampling_error: float     # relative, of the torque without ``drive``


def solve(grounds: Runs, lifted: Runs, robot: RobotParams, *, with_duty: bool) -> Solution:
    """Return the fits with their standard errors; EstimatorError if they are not possible."""
    def fits(assumed: Assumptions) -> tuple[Drive | None, LiftedFit | None, GroundFit]:
        drive = fit_drive(grounds, assumed) if with_duty else None
        on_ground, off_ground = ([_with_torque(rows, drive, robot, assumed) for rows in runs]
                                 for runs in (grounds, lifted))
        wheels = _fit_lifted(off_ground, robot, measured_duty=drive is not None) if (
            lifted) else None
        return drive, wheels, _fit_ground(on_ground, robot, wheels, assumed.inertia)

    drive, wheels, ground = fits(Assumptions())
    others = [fits(assumed) for assumed in (
        Assumptions(slip=SLIP_SHARE), Assumptions(command_delay=DELAY_SIGMA),
        Assumptions(reading_delay=DELAY_SIGMA))] if with_duty else []
    kappa, heavier = ground.kappa.value, fits(Assumptions(inertia=1.0))[2].kappa.value
    sampling = _sampling_error(grounds) if drive is None else drive.relative_sigma
    relative = (sampling, robot.wheel_radius_sigma, ACCEL_SCALE_SIGMA)
    sigma = math.hypot(ground.kappa.sigma, heavier - kappa,
                       *(other[2].kappa.value - kappa for other in others),
                       *(kappa * part for part in relative))
    shifts = tuple(math.hypot(*(
        other.means[index].value - wheels.means[index].value
        for _, other, _ in others if other is not None)) for index in range(3)) if (
            wheels is not None) else ()
    return Solution(drive, wheels, ground, Uncertain(kappa, sigma), heavier - kappa, shifts,
                    sampling if drive is None else 0.0)


def _all(runs: Runs, name: str) -> Array:
    return np.concatenate([getattr(rows, name) for rows in runs])


def _own(runs: Runs) -> Array:
    """Return a column for each run, 1 in its own rows, shape (n, len(runs))."""
    return np.repeat(np.eye(len(runs)), [len(rows.time) for rows in runs], axis=0)


def _fit(runs: Runs, columns: Sequence[Array], target: Array, prior: Prior, sigma: Array,
         known: Array | slice = slice(None)) -> Fit:
    """Return the fit of the rows ``known``; rows that share samples are correlated."""
    step = float(np.median(np.concatenate([np.diff(rows.time) for rows in runs])))
    matrix = np.column_stack(columns)[known]
    return regression(
        Rows(_all(runs, 'time')[known], matrix, target[known], sigma[known]), prior,
        Errors(max(math.ceil(HAC_TIME / step), max(rows.lags for rows in runs))))


def steady_motion(runs: Runs) -> str:
    """Return why the speed changes too little to separate torque and speed, '' if it does not."""
    changes = float(np.concatenate([rows.force - rows.force.mean() for rows in runs]).std())
    return '' if changes > MIN_SPEED_CHANGES else (
        f'acceleration of {changes:.2g} m/s2 rms: requires starts and stops')


def speed_gains(runs: Runs) -> list[Uncertain]:
    """
    Return the duty per speed [s/rad] of each motor; EstimatorError if not observable.

    Only straight motion counts: in turns tires scrub, a torque that no row contains.
    """
    everything, runs = runs, [_straight(rows) for rows in runs]
    if sum(len(rows.time) for rows in runs) < MIN_ROWS or np.isnan(_all(runs, 'duty')).any():
        raise EstimatorError('requires motor_commands during straight motion')
    if steady := steady_motion(everything):
        raise EstimatorError(steady)
    speed, duty = _all(runs, 'speed'), _all(runs, 'duty')
    typical = float(np.median(np.abs(duty / speed)))
    target = duty - COMMAND_DELAY * _all(runs, 'duty_rate')
    none = Prior.of(*[None] * (4 + len(runs)))
    return [_fit(runs, [speed[:, i], _all(runs, 'acceleration')[:, i], _all(runs, 'force'),
                        np.sign(speed[:, i]), _own(runs)], target[:, i], none,
                 typical * _all(runs, 'speed_sigma')[:, i]).estimate(0) for i in range(4)]


def mean_gain(gains: Sequence[Uncertain]) -> Uncertain:
    """Return the mean of the motors, whose errors from timestamps are the same."""
    values = np.array([gain.value for gain in gains])
    common = float(np.mean([gain.sigma ** 2 for gain in gains]))
    return Uncertain(float(values.mean()), math.sqrt(common + float(values.var(ddof=1)) / 4.0))


def fit_drive(runs: Runs, assumed: Assumptions) -> Drive:
    """Return torque over duty; raise EstimatorError with the reason if not observable."""
    gains = speed_gains(runs)
    torque, duty = _all(runs, 'center_torque'), _all(runs, 'center_duty')
    slip = _all(runs, 'center_slip')
    speed = (_all(runs, 'center_speed') + assumed.slip * slip
             + (READING_DELAY + assumed.reading_delay) * _all(runs, 'acceleration'))
    found = []
    for i, gain in enumerate(gains):
        known = ~np.isnan(torque[:, i] + duty[:, i])
        if known.sum() < MIN_ROWS:
            raise EstimatorError('all torques are measured within a few milliseconds of a change '
                                 'of the duty')
        acting = duty[:, i] - gain.value * speed[:, i]
        typical = float(np.std(torque[known, i]) / max(np.std(acting[known]), 1e-9))
        fit = _fit(runs, [acting, np.ones(len(acting))], torque[:, i], Prior.of(None, None),
                   typical * SLIP_SHARE * gain.value * np.abs(slip[:, i]), known)
        if not fit.estimate(0).determined:
            raise EstimatorError('the torque does not follow the duty, or the duty hardly changes')
        found.append((*fit.estimate(0), fit.estimate(1).value))
    stall, sigma, offset = np.array(found).T
    if not (stall > 0.0).all():
        raise EstimatorError('the torque falls with the duty: a sign is wrong')
    return Drive(stall, offset, np.array([gain.value for gain in gains]),
                 float(np.linalg.norm(sigma / stall)) / 4.0,
                 float(stall.mean()) * mean_gain(gains).sigma)


def _with_torque(rows: MotorRows, drive: Drive | None, robot: RobotParams,
                 assumed: Assumptions) -> MotorRows:
    """Return the rows with a known torque: from the duty, or the mean of its readings."""
    if drive is not None and not np.isnan(rows.duty).any():
        rows = drive.replaced(rows, assumed.command_delay)
    else:
        rows = replace(rows, torque_sigma=SAMPLED_TORQUE_SHARE * robot.motor.inertia
                       * np.abs(rows.acceleration))
    return rows.where(np.asarray(np.isfinite(rows.torque).all(axis=1)))


def _load_torque(robot: RobotParams) -> float:
    return 0.25 * robot.mass * GRAVITY * robot.wheel_radius


def _fit_lifted(runs: Runs, robot: RobotParams, *, measured_duty: bool) -> LiftedFit:
    """Return inertia and friction of lifted wheels; EstimatorError if there are too few rows."""
    _check_rows(runs)
    if any(_following(rows, robot) > MAX_FOLLOWING for rows in runs):
        raise EstimatorError('the body accelerates with its wheels: they are not lifted')
    prior = Prior.of(None, None, None, *[(0.0, OFFSET_SHARE * _load_torque(robot))] * len(runs))
    speed = _all(runs, 'speed')
    fits = [_fit(runs, [_all(runs, 'acceleration')[:, i], np.sign(speed[:, i]), speed[:, i],
                        _own(runs)], _all(runs, 'torque')[:, i], prior,
                 _all(runs, 'torque_sigma')[:, i]) for i in range(4)]
    values, variances = (np.mean(columns, axis=0)[:3].tolist() for columns in (
        [fit.values for fit in fits], [np.diag(fit.covariance) / 4.0 for fit in fits]))
    inertia, coulomb, viscous = (Uncertain(value, math.sqrt(variance))
                                 for value, variance in zip(values, variances))
    if not measured_duty or any(np.isnan(rows.duty).any() for rows in runs):
        inertia = Uncertain(inertia.value, math.hypot(
            inertia.sigma, SAMPLED_SIGMA * inertia.value))
    return LiftedFit((inertia, coulomb, viscous), [fit.estimate(INERTIA) for fit in fits],
                     float(np.abs(speed).max()))


def _fit_ground(runs: Runs, robot: RobotParams, lifted: LiftedFit | None,
                inertia_error: float) -> GroundFit:
    """
    Return the force balance; the inertia comes from ``lifted`` wheels or from the parameters.

    It is larger than its best estimate by ``inertia_error`` standard errors. The recording does
    not change it: the difference between the accelerations of wheels and body is slip and noise.
    Raises EstimatorError if the wheels are lifted or slide, or rows are too few.
    """
    runs = [_straight(rows) for rows in runs]
    _check_rows(runs)
    for rows in runs:
        if _following(rows, robot) < MIN_FOLLOWING:
            raise EstimatorError('the body does not accelerate with its wheels: they slide, or '
                                 'are lifted')
        _check_braking(rows, robot)
    lever, count = robot.mass * robot.wheel_radius, len(runs)
    speed, acceleration = _all(runs, 'speed'), _all(runs, 'acceleration')
    assumed = Uncertain(robot.motor.inertia, CONFIGURED_SIGMA * robot.motor.inertia)
    inertia = sum(part * scale for part, scale in zip(
        assumed if lifted is None else lifted.means[INERTIA], (1.0, inertia_error)))
    # from lifted wheels it is known in the unit of the measured torque, otherwise in kg m2
    true, measured = (inertia, 0.0) if lifted is None else (0.0, inertia)
    viscous = lifted.means[VISCOUS] if lifted is not None else Uncertain(
        robot.motor.viscous_friction,
        VISCOUS_SHARE * _load_torque(robot) / float(np.abs(speed).max()))
    force = lever * np.concatenate([rows.force - rows.rest_force.value for rows in runs])
    torque = _all(runs, 'torque')

    def fit(wheels: Sequence[int]) -> tuple[Fit, Array, Array]:
        share, own = len(wheels) / 4.0, _own(runs)
        columns = np.column_stack([
            share * force + true * acceleration[:, wheels].sum(axis=1),
            speed[:, wheels].sum(axis=1), share * _all(runs, 'force_rate'),
            own * np.sign(speed)[:, wheels].sum(axis=1)[:, None], own])
        target = (torque - measured * acceleration)[:, wheels].sum(axis=1)
        offsets = [(0.0, math.hypot(
            share * lever * rows.rest_force.sigma,
            math.sqrt(len(wheels)) * OFFSET_SHARE * _load_torque(robot))) for rows in runs]
        prior = Prior.of(None, viscous, (0.0, lever * TORQUE_DELAY_SIGMA), *[None] * count,
                         *offsets)
        sigma = _all(runs, 'torque_sigma')[:, wheels].sum(axis=1)
        return _fit(runs, [columns], target, prior, sigma), columns, target

    all_wheels, columns, target = fit(range(4))
    kappa = all_wheels.estimate(KAPPA)
    balance = np.asarray(force + (true + measured / kappa.value) * acceleration.sum(axis=1))
    other = target - columns[:, 1:] @ all_wheels.values[1:]
    return GroundFit(
        _with_attenuation(kappa, runs),
        weighted_mean([all_wheels.estimate(3 + number) for number in range(count)]),
        [fit([wheel])[0].estimate(KAPPA) for wheel in range(4)], balance,
        other + measured * acceleration.sum(axis=1))


def _check_rows(runs: Runs) -> None:
    found = sum(len(rows.time) for rows in runs)
    if found < MIN_ROWS:
        raise EstimatorError(f'{found} readings in straight motion, expected at least {MIN_ROWS}: '
                             'each needs half a second in one direction')


def _straight(rows: MotorRows) -> MotorRows:
    """Return the rows in which all wheels rotate in one direction at similar speeds."""
    left, right = (rows.speed[:, side].mean(axis=1) for side in (LEFT, RIGHT))
    same = np.abs(rows.direction.sum(axis=1)) == 4
    return rows.where(np.asarray(
        same & (np.abs(right - left) < MAX_TURN_SHARE * np.abs(left + right))))


def _following(rows: MotorRows, robot: RobotParams) -> float:
    """Return the acceleration of the body over that of its wheels; NaN if that is too small."""
    if not len(rows.time):
        return math.nan
    wheels = robot.wheel_radius * rows.acceleration.mean(axis=1)
    wheels, force = wheels - wheels.mean(), rows.force - rows.force.mean()
    if math.sqrt(float(np.mean(wheels ** 2))) < MIN_FOLLOWED_ACCELERATION:
        return math.nan
    return float(np.sum(force * wheels) / np.sum(wheels ** 2))


def _check_braking(rows: MotorRows, robot: RobotParams) -> None:
    """Raise EstimatorError if the torque drives while the body brakes harder than friction."""
    motor, direction = robot.motor, rows.direction[:, 0]
    balance = direction * (robot.mass * robot.wheel_radius * (
        rows.force - rows.rest_force.value) + motor.inertia * rows.acceleration.sum(axis=1))
    friction = 4.0 * (motor.coulomb_friction + motor.axle_friction * _load_torque(robot))
    braking = balance < -BRAKING_FACTOR * friction
    if braking.sum() >= MIN_BRAKING_ROWS and float(np.median(
            (direction * rows.torque.sum(axis=1))[braking])) > 0.0:
        raise EstimatorError('the motor torque is positive while the robot brakes: the boards '
                             'report magnitudes of currents')


def _with_attenuation(kappa: Uncertain, runs: Runs) -> Uncertain:
    """Return ``kappa`` with the bias from noise and vibration of the IMU in its sigma."""
    noise = sum(len(rows.time) * rows.force_noise ** 2 for rows in runs)
    signal = sum(float(np.sum((rows.force - rows.force.mean()) ** 2)) for rows in runs)
    return Uncertain(kappa.value, math.hypot(
        kappa.sigma, kappa.value * noise / max(signal, 1e-9)))


def _sampling_error(runs: Runs) -> float:
    """
    Return the relative error of the mean torque from readings in step with the commands.

    In step, the force has a ripple with the period of the readings, of an amplitude in proportion
    to the acceleration. Its values at the readings and a quarter of a period away give the
    amplitude, independent of the phase.
    """
    force = np.concatenate([rows.force - rows.force.mean() for rows in runs])
    shares = [_fit(runs, [force], ripple, Prior.of(None), np.zeros(len(force))).estimate(0)
              for ripple in _all(runs, 'ripple').T]
    excess = sum(share.value ** 2 - share.sigma ** 2 for share in shares)  # over that of noise
    return SAMPLING_FACTOR * math.sqrt(max(excess, 0.0))
