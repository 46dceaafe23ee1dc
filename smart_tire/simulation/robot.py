# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Simulated robot: plant, motors, and IMU, films and ground truth, each sampled at its rate."""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np
import numpy.typing as npt

from smart_tire import rotation
from smart_tire.models.vehicle.drive import measured_torque
from smart_tire.parameters.robot import RobotParams
from smart_tire.parameters.simulation import SensorErrorParams, SimulatorParams
from smart_tire.protocol.roboclaw import CURRENT_RESOLUTION
from smart_tire.samples import Four, four, GRAVITY, ImuSample, NS_PER_S, Vector3
from smart_tire.simulation.device_emulators import SensorNodeEmulator
from smart_tire.simulation.films import FilmBatch, FilmSampler
from smart_tire.simulation.plant import Plant, STEP_NS, SurfaceMap
from smart_tire.simulation.truth import CrossingTruth, true_odometry, true_slip, Truth

Observation = ImuSample | FilmBatch | Truth

TRUTH_RATE = 100.0  # Hz, of the ground truth topics (docs/topics.md)
MOTOR_RNG_STREAM = 4  # index of the random stream of the motors


class PeriodicTimer:
    """Timer with a fixed period [ns] on a grid that starts at 0."""

    def __init__(self, period_ns: float) -> None:
        self._period_ns, self._count = period_ns, 1
        self.next_ns = period_ns  # of the grid

    def expired(self, time_ns: int) -> bool:
        """Return whether the next time of the grid is reached; then advance by one period."""
        if time_ns < self.next_ns:
            return False
        self._count += 1
        self.next_ns = self._count * self._period_ns
        return True


class Robot:
    """Plant, motors, IMU, films and ground truth; all times are since the start."""

    def __init__(self, params: SimulatorParams, plant: type[Plant] = Plant) -> None:
        robot = params.robot
        seeds = np.random.SeedSequence(params.seed).spawn(1 + len(robot.film.wheels))
        imu_rng, *film_rngs = map(np.random.default_rng, seeds)
        self.motors = Motors(params)
        self.plant = plant(robot, params.drive, SurfaceMap(params.ground), params.start,
                           self.motors.friction_scale)
        self.sensor_nodes = {wheel: _sensor_node(wheel, params, rng)
                             for wheel, rng in zip(robot.film.wheels, film_rngs)}
        self._params = robot
        self._imu = ImuModel(robot, params.errors, imu_rng)
        self._films = [FilmSampler(wheel, node, params, rng)
                       for (wheel, node), rng in zip(self.sensor_nodes.items(), film_rngs)]
        self._crossings = [[CrossingTruth(films, robot, group) for group in robot.film_groups]
                           for films in self._films]
        self._imu_due = PeriodicTimer(NS_PER_S / params.imu_rate)
        self._truth_due = PeriodicTimer(NS_PER_S / TRUTH_RATE)

    @property
    def next_ns(self) -> int:
        """Return the time of the next step that yields an observation."""
        due = min(self._imu_due.next_ns, self._truth_due.next_ns,
                  *(films.full_ns for films in self._films))
        return math.ceil(due / STEP_NS) * STEP_NS

    def step(self, duty: Sequence[float]) -> list[Observation]:
        """Advance by one step of the plant; return its observations."""
        plant, observations = self.plant, list[Observation]()
        plant.step(duty)
        now_ns = plant.time_ns
        if self._imu_due.expired(now_ns):
            observations.append(ImuSample(now_ns, *self._imu.read(plant)))
        if self._truth_due.expired(now_ns):
            observations += true_odometry(plant, now_ns), true_slip(plant, self._params, now_ns)
        for films, groups in zip(self._films, self._crossings):
            if films.due_ns <= now_ns:
                for batch in films.observe(plant):
                    observations.append(batch)
                    for crossings in groups:
                        observations += crossings.ended_in(batch.trace)
        return observations


def _sensor_node(wheel: str, params: SimulatorParams,
                 rng: np.random.Generator) -> SensorNodeEmulator:
    """Return the sensor node of ``wheel`` with random clock error and phase."""
    period_us = round(1e6 / params.robot.film.sample_rate)
    return SensorNodeEmulator(params.address_of()[wheel], period_us=period_us,
                              clock_error=rng.normal(0.0, params.radio.clock_error),
                              first_us=int(rng.integers(period_us)))


class ImuModel:
    """Accelerometer and gyroscope; turn-on bias and mounting tilt are drawn once."""

    def __init__(self, robot: RobotParams, errors: SensorErrorParams,
                 rng: np.random.Generator) -> None:
        imu = robot.imu
        self._rng = rng
        self._arm_x = imu.position[0] - robot.center_of_mass[0]
        self._arm_y = imu.position[1] - robot.center_of_mass[1]
        roll, pitch = rng.normal(0.0, errors.imu_tilt, 2)
        mounting = rotation.matrix(*imu.rotation) @ rotation.matrix(roll, pitch, 0.0)
        self._from_base = mounting.T
        self._accel_bias = rng.normal(0.0, imu.accel_bias, 3)
        self._gyro_bias = rng.normal(0.0, imu.gyro_bias, 3)
        self._accel_noise, self._gyro_noise = imu.accel_noise, imu.gyro_noise
        self._gyro_scale = imu.gyro_scale

    def read(self, plant: Plant) -> tuple[Vector3, Vector3]:
        """Return specific force [m/s2] and angular rate [rad/s] in ``imu_link``."""
        force = self._from_base @ self._specific_force(plant) + self._accel_bias
        rate = self._gyro_scale * self._from_base[:, 2] * plant.yaw_rate + self._gyro_bias
        noise = self._rng.standard_normal((2, 3))
        return (_vector(force + self._accel_noise * noise[0]),
                _vector(rate + self._gyro_noise * noise[1]))

    def _specific_force(self, plant: Plant) -> Vector3:
        a_x, a_y = plant.acceleration
        spin, rate2 = plant.yaw_acceleration, plant.yaw_rate**2
        return (a_x - spin * self._arm_y - rate2 * self._arm_x,
                a_y + spin * self._arm_x - rate2 * self._arm_y, GRAVITY)


def encoder_counts(plant: Plant, counts_per_revolution: float,
                   ahead: float = 0.0) -> tuple[int, int, int, int]:
    """Return the encoder counts since the start, extrapolated ``ahead`` [s] of the plant."""
    scale = counts_per_revolution / math.tau
    return four(math.floor((angle + ahead * speed) * scale)
                for angle, speed in zip(plant.wheel_angle, plant.wheel_speed))


def wheel_angles(counts: tuple[int, int, int, int], counts_per_revolution: float) -> Four:
    """Return the wheel angles [rad] of ``counts``."""
    return four(count * (math.tau / counts_per_revolution) for count in counts)


def _vector(values: npt.NDArray[np.float64]) -> Vector3:
    x, y, z = values.tolist()
    return x, y, z


class Motors:
    """
    Errors of the four motors, drawn once, and their measured currents.

    They have a random stream of their own: all other errors of a seed are independent of it.
    """

    def __init__(self, params: SimulatorParams) -> None:
        errors, self._motor = params.errors, params.robot.motor
        self._rng = np.random.default_rng([params.seed, MOTOR_RNG_STREAM])
        common = self._rng.normal(0.0, errors.torque_constant)
        spread = self._rng.normal(0.0, errors.torque_constant_spread, 4)
        self._torque_constant = self._motor.torque_constant * (1.0 + common + spread)  # N m/A
        self._offset = self._rng.normal(0.0, errors.torque_offset, 4)  # N m
        self._noise = errors.torque_noise  # N m
        self.friction_scale: list[float] = (
            1.0 + self._rng.normal(0.0, errors.motor_friction, 4)).tolist()

    def currents(self, plant: Plant) -> Four:
        """Return one reading of the currents [A], positive driving forward."""
        ripple = self._rng.normal(0.0, self._noise, 4)
        currents = (np.array(plant.motor_torque) + self._offset + ripple) / self._torque_constant
        return four((np.round(currents / CURRENT_RESOLUTION) * CURRENT_RESOLUTION).tolist())

    def reported(self, currents: Four, duty: Four) -> Four:
        """Return ``currents`` with the sign that the boards report, see ``motor.current_sign``."""
        if self._motor.current_sign == 'signed':
            return currents
        return four(current if value > 0.0 else -current if value < 0.0 else -abs(current)
                    for current, value in zip(currents, duty))

    def torques(self, plant: Plant, duty: Four, velocity: Four) -> Four:
        """
        Return one reading of the motor torques [N m], as ``motor_driver`` reports them.

        ``duty`` are the applied duties, ``velocity`` the measured wheel speeds [rad/s].
        """
        reported = self.reported(self.currents(plant), duty)
        return four(measured_torque(*one, torque_constant=self._motor.torque_constant,
                                    current_sign=self._motor.current_sign)
                    for one in zip(reported, duty, velocity))
