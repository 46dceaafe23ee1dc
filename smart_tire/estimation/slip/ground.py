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

"""
Force balance of the robot on brush tires, with the ground given and its errors considered.

The forces of the ground minus the rolling resistance equal mass times specific force at the center
of mass: the slope cancels. Tire forces are B(17) to B(22) with a stiffness of its own sideways::

    s = (r w - v_x, -k v_y) / |r w|,  F = C_x s g(t),  t = C_x |s| / (3 mu F_z)
    g = 1 - t + t^2 / 3 for t < 1, above 1 / (3 t)
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

from smart_tire.estimation.slip.imu_input import ImuInput
from smart_tire.estimation.slip.kalman import KalmanFilter, SENSORS_HELD
from smart_tire.estimation.slip.noise import LearnedVariance, MAX_NIS
from smart_tire.estimation.slip.state import State
from smart_tire.models.constants import GRAVITY
from smart_tire.models.vehicle.skid_steer import AXLE_SIGNS, SIDE_SIGNS
from smart_tire.parameters import RobotParams
from smart_tire.samples import Four, GroundState
from smart_tire.uncertain import Uncertain

PRIORS = (Uncertain(0.45, 0.315), Uncertain(0.025, 0.025), Uncertain(0.5, 0.3),
          Uncertain(0.9, 0.15))  # -, mu, rolling resistance, its lateral share, C_y / C_x
GROUND_SIGMAS = (0.5, 0.7, 0.04, 0.3, 0.2, 0.0, 0.0)  # of another ground, in the order of State:
# ln C_x, ln mu, rolling resistance, its lateral share, ln C_y / C_x; the robot stays the same
SILENT_TIME = 1.25        # s without ground_state, two and a half periods, after which it ends
EXPIRY_TIME = 5.0         # s after which it has ended
SLIP_FLOOR = 0.05         # m/s, smallest denominator of a slip
MIN_ROLLING_SPEED = 0.1   # m/s, of the slower side: the forces are not used below
MIN_RESISTED_SPEED = 0.02  # m/s, below which rolling resistance is proportional to the speed
BALANCE_SIGMA = 0.05      # m/s2, prior error of the model, which is learned ...
MIN_BALANCE_SIGMA = 0.02  # m/s2, ... down to this one
MODEL_TIME = 0.3          # s, correlation time of that error
NOISE_TIME = 5.0          # s, over which it is learned
DOUBT_TIME = 2.0          # s after a change that the filter has found: the window needs them
CHANGE_TIME = 0.3         # s, time constant of the innovations that show a change of the ground
CHANGE_NIS = 5.0          # their mean square, each at most MAX_NIS, beyond which it has changed


class TireForce(NamedTuple):
    """Force [N] of the ground on a wheel and its derivatives by slip and parameters."""

    x: float
    y: float
    xx: float           # by s_x
    xy: float           # by s_y, and of y by s_x
    yy: float
    x_by_friction: float  # by ln mu; the remaining part is linear in C_x
    y_by_friction: float


def brush_force(s_x: float, s_y: float, stiffness: float, limit: float) -> TireForce:
    """
    Return the force of a brush tire with slip (s_x, s_y) [-] and stiffness [N].

    ``limit`` [N] is mu F_z.

    >>> force = brush_force(0.1, 0.0, 52.7, 0.47 * 26.7)
    >>> print(f'{force.x:.2f} N')
    4.60 N
    """
    square = max(s_x * s_x + s_y * s_y, 1e-18)
    t = stiffness * math.sqrt(square) / (3.0 * limit)
    if t < 1.0:
        slope, bend = stiffness * (1.0 - t + t * t / 3.0), stiffness * t * (t / 1.5 - 1.0)
    else:
        slope, bend = stiffness / (3.0 * t), -stiffness / (3.0 * t)
    k = bend / square
    return TireForce(slope * s_x, slope * s_y, slope + k * s_x * s_x, k * s_x * s_y,
                     slope + k * s_y * s_y, -bend * s_x, -bend * s_y)


class ForceBalance:
    """Ground as given by ``GroundState``, and the corrections by the balance of forces."""

    def __init__(self, robot: RobotParams, kalman: KalmanFilter) -> None:
        self._robot, self._kalman = robot, kalman
        self._wheel_x = (0.5 * robot.wheelbase * AXLE_SIGNS).tolist()
        self._wheel_y = (0.5 * robot.track_width * SIDE_SIGNS).tolist()
        self._x_imu, self._y_imu = robot.imu.position[:2]
        self._height = robot.center_of_mass[2] + robot.wheel_radius
        self._center_of_mass = tuple(map(
            Uncertain, robot.center_of_mass[:2], robot.center_of_mass_sigma))
        self._given = (1.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0)  # in the order of State
        self._noise = [LearnedVariance(BALANCE_SIGMA, MIN_BALANCE_SIGMA, NOISE_TIME) for _ in 'xy']
        self._innovations = LearnedVariance(1.0, 0.0, CHANGE_TIME)
        self._silent = math.inf  # s, since the last ground_state
        self._since_change = math.inf  # s, since the filter has found a change of the ground
        self.changes = 0         # of the ground, found by the filter
        self.innovation = 0.0    # of the last balance along y, in standard deviations

    @property
    def active(self) -> bool:
        """Return whether the ground is known."""
        return self._silent < SILENT_TIME + EXPIRY_TIME

    def set_ground(self, ground: GroundState) -> None:
        """
        Take the ground as given, with the errors that are reported.

        After a change that this filter has found, a ground as before is not news yet.
        """
        self._silent = 0.0
        if self._since_change < DOUBT_TIME and self._is_as_before(ground):
            return
        self._since_change = math.inf
        reported = (ground.friction_coefficient, ground.rolling_resistance, ground.lateral_share,
                    ground.lateral_stiffness_ratio, ground.center_of_mass_x,
                    ground.center_of_mass_y)
        stiffness = ground.stiffness
        mu, resistance, share, ratio, *center = (
            one if math.isfinite(one.value) and math.isfinite(one.sigma) else prior
            for one, prior in zip(reported, (*PRIORS, *self._center_of_mass)))
        self._given = (  # type: ignore[assignment]
            stiffness.value, mu.value, resistance.value, share.value, ratio.value,
            *(one.value for one in center))
        sigmas = (stiffness.sigma / stiffness.value, mu.sigma / mu.value, resistance.sigma,
                  share.sigma, ratio.sigma / ratio.value, *(one.sigma for one in center))
        P = self._kalman.P
        for row, sigma in enumerate(sigmas, int(State.LN_STIFFNESS)):
            # of what was known the share is kept that the new error has of the old one
            old = math.sqrt(P[row, row])
            keep = min(1.0, sigma / old) if old > 0.0 else 0.0
            P[row, :] *= keep
            P[:, row] *= keep
            P[row, row] = sigma ** 2
        a, b = State.LN_STIFFNESS, State.LN_FRICTION
        P[a, b] = P[b, a] = ground.stiffness_friction_correlation * sigmas[0] * sigmas[1]

    def _is_as_before(self, ground: GroundState) -> bool:
        """Return whether C_x and rolling resistance are within their errors of those given."""
        return all(abs(new.value - old) < 2.0 * new.sigma for new, old in (
            (ground.stiffness, self._given[0]), (ground.rolling_resistance, self._given[2])))

    def age(self, dt: float) -> None:
        """Let the ground become unknown while ``ground_state`` is silent; ``dt`` [s] passed."""
        self._silent += dt
        self._since_change += dt
        if self.active and self._silent > SILENT_TIME:
            self._widen(min(dt / EXPIRY_TIME, 1.0))

    def add_wheel_innovation(self, nis: float, duration: float) -> None:
        """Widen the covariance of the ground if wheels and forces contradict each other."""
        if not self.active:
            return
        self._innovations.add(min(nis, MAX_NIS), duration)
        if self._innovations.variance > CHANGE_NIS:
            self._widen(1.0)
            self._innovations = LearnedVariance(1.0, 0.0, CHANGE_TIME)
            self.changes += 1
            self._since_change = 0.0

    def _widen(self, share: float) -> None:
        for row, sigma in enumerate(GROUND_SIGMAS, int(State.LN_STIFFNESS)):
            variance = float(self._kalman.P[row, row])
            self._kalman.P[row, row] += share * max(sigma ** 2 - variance, 0.0)

    def correct(self, imu: ImuInput, residual: Four, dt: float) -> bool:
        """
        Correct with the balance along x and y at the last IMU reading, after a step of ``dt`` [s].

        Return False if it does not hold: ground unknown, or robot too slow.
        """
        reading, x = imu.reading, self._kalman.x
        assert reading is not None
        W = reading.yaw_rate - x[State.GYRO_BIAS_Z]
        rolling = [x[State.V_X] + (self._y_imu - y) * W + x[State.SLIP_VEL_L + i % 2] + residual[i]
                   for i, y in enumerate(self._wheel_y)]
        if not self.active or min(map(abs, rolling)) < MIN_ROLLING_SPEED:
            return False
        expected, H = self._balance(
            x, reading.force_x, reading.force_y, W, imu.yaw_accel, rolling)
        rows = list(H)
        shared = -0.5 * dt * imu.force_variance  # the sample ends the step that was predicted
        for axis, velocity in enumerate((State.V_X, State.V_Y)):
            h = [H[row][axis] for row in rows]
            # the error of the model lasts: as white noise it has the same mean over its time
            variance = (2.0 * MODEL_TIME / dt * self._noise[axis].variance
                        + imu.force_variance)
            total = self._kalman.correct(
                -expected[axis], rows, h, variance, (velocity, shared), SENSORS_HELD)
            excess = expected[axis] ** 2 - total
            self._noise[axis].add(self._noise[axis].variance + excess, dt)
            self.innovation = expected[axis] / math.sqrt(total)
        return True

    def _balance(self, x: Sequence[float], force_x: float, force_y: float, W: float,
                 yaw_accel: float, rolling: Sequence[float]
                 ) -> tuple[tuple[float, float], dict[int, list[float]]]:
        """
        Return model minus measurement [m/s2] along x and y, and its Jacobian.

        The Jacobian maps each row of the state to its two derivatives.
        """
        mass = self._robot.mass
        stiffness, friction, resistance, share, ratio, com_x, com_y = self._given
        a_x, a_y = force_x - x[State.ACCEL_BIAS_X], force_y - x[State.ACCEL_BIAS_Y]
        arm_x, arm_y = com_x - self._x_imu, com_y - self._y_imu
        sums = [-mass * (a_x - yaw_accel * arm_y - W * W * arm_x),
                -mass * (a_y + yaw_accel * arm_x - W * W * arm_y)]
        by_v_x, by_v_y, by_bias = [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]
        by_slip = [[0.0, 0.0], [0.0, 0.0]]
        by_stiffness, by_friction, by_resistance = [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]
        by_share, by_ratio = [0.0, 0.0], [0.0, 0.0]
        pitch = (GRAVITY * com_x - self._height * a_x) / self._robot.wheelbase
        roll = (GRAVITY * com_y - self._height * a_y) / self._robot.track_width
        for i, (w_x, w_y) in enumerate(zip(self._wheel_x, self._wheel_y)):
            v_x = x[State.V_X] + (self._y_imu - w_y) * W
            v_y = x[State.V_Y] + (w_x - self._x_imu) * W
            load = max(mass * (0.25 * GRAVITY + 0.5 * pitch * math.copysign(1.0, w_x)
                               + 0.5 * roll * math.copysign(1.0, w_y)), 0.01 * mass)
            inverse = 1.0 / max(abs(rolling[i]), SLIP_FLOOR)
            sign = math.copysign(1.0, rolling[i])
            s_x, s_y = (rolling[i] - v_x) * inverse, -ratio * v_y * inverse
            f = brush_force(s_x, s_y, stiffness, friction * load)
            speed = max(math.hypot(v_x, v_y), MIN_RESISTED_SPEED)
            heading = max(-1.0, min(1.0, v_x / MIN_RESISTED_SPEED))
            along_x, along_y = load * v_x / speed, load * v_y / speed
            drag_x = (1.0 - share) * load * heading + share * along_x
            drag_y = share * along_y
            sums[0] += f.x - resistance * drag_x
            sums[1] += f.y - resistance * drag_y
            # ds/d(r w) at constant velocity, ds/dv
            d_x, d_y = inverse * (1.0 - sign * s_x), -inverse * sign * s_y
            lateral = ratio * inverse
            plough = resistance * share * load / speed
            for axis, (to_x, to_y, force, by_mu, drag, by_heading) in enumerate((
                    (f.xx, f.xy, f.x, f.x_by_friction, drag_x, along_x - load * heading),
                    (f.xy, f.yy, f.y, f.y_by_friction, drag_y, along_y))):
                by_rolling = to_x * d_x + to_y * d_y
                forward, sideways = by_rolling - to_x * inverse, -to_y * lateral
                if axis:
                    sideways -= plough
                by_slip[i % 2][axis] += by_rolling
                by_v_x[axis] += forward
                by_v_y[axis] += sideways
                by_bias[axis] -= forward * (self._y_imu - w_y) + sideways * (w_x - self._x_imu)
                by_stiffness[axis] += force - by_mu
                by_friction[axis] += by_mu
                by_resistance[axis] -= drag
                by_share[axis] -= resistance * by_heading
                by_ratio[axis] += to_y * s_y
        H = {State.V_X: by_v_x, State.V_Y: by_v_y, State.GYRO_BIAS_Z: by_bias,
             State.SLIP_VEL_L: by_slip[0], State.SLIP_VEL_R: by_slip[1],
             State.ACCEL_BIAS_X: [mass, 0.0], State.ACCEL_BIAS_Y: [0.0, mass],
             State.LN_STIFFNESS: by_stiffness, State.LN_FRICTION: by_friction,
             State.RESISTANCE: by_resistance, State.LATERAL_SHARE: by_share,
             State.LN_LATERAL: by_ratio, State.COM_X: [mass * W * W, -mass * yaw_accel],
             State.COM_Y: [mass * yaw_accel, mass * W * W]}
        return ((sums[0] / mass, sums[1] / mass),
                {int(row): [value / mass for value in values] for row, values in H.items()})
