"""
Wheel speeds that a measured acceleration on a straight line requires: the inverse brush model.

From ``m a + drag = sum of brush forces(slip)`` the acceleration gives the force, the force the
slip, and slip and speed over ground the wheel speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.recording import Signal
from smart_tire.calibration.tire.straight_segments import StraightSegments
from smart_tire.models.constants import GRAVITY
from smart_tire.models.tire.shared_slip import linear_tire_force
from smart_tire.models.vehicle.skid_steer import normal_loads
from smart_tire.parameters import RobotParams

MAX_SLIP = 0.5       # -, in both directions; beyond, wheels slide and speeds carry no information
SEGMENT_STEP = 0.01  # m/s and m/s2, for derivatives with respect to segment parameters


class Common(IntEnum):
    """Parameters of all segments; those of each segment follow: initial speeds, then biases."""

    COMPLIANCE = 0     # -, configured C_x over C_x
    DRAG = 1           # share of the weight, against the motion
    FRICTION = 2       # -, ln of mu
    LATENCY_ERROR = 3  # s, of the wheel timestamps in addition to the configured latency
    RADIUS_ERROR = 4   # -, slip at zero force: relative error of the rolling radius


# parameters that do not change the forces
FORCE_INDEPENDENT = {Common.COMPLIANCE, Common.LATENCY_ERROR, Common.RADIUS_ERROR}
COMMON_STEPS = (5e-3, 5e-4, 0.02, 2e-4, 1e-3)  # in the order of ``Common``, for derivatives


@dataclass(frozen=True)
class Motion:
    """Motion predicted at the IMU samples, shape (m,) each."""

    ground: Array        # m/s, speed over ground
    slip: Array          # -, B(3)'s lambda of all wheels
    force: Array         # N, of all wheels together, positive when driving
    linear_force: Array  # N, C_x times the slip, positive when driving forward


class StiffnessModel:
    """Prediction of the wheel speeds in the straight segments of one recording."""

    def __init__(self, segments: StraightSegments, robot: RobotParams) -> None:
        self.segments, self._robot = segments, robot
        self._latency = robot.encoder.latency

    def speeds(self, common: Array, initial_speeds: Array, biases: Array,
               linear_force: Array | None = None) -> Array:
        """
        Return the mean wheel speeds [m/s] of all intervals (n,).

        ``initial_speeds`` [m/s] are those over ground at the start of each segment, ``biases``
        [m/s2] the accelerometer errors in it; ``linear_force`` (m,) [N] is C_x times the slip,
        if already computed.
        """
        segments = self.segments
        motion = self.motion(common, initial_speeds, biases, linear_force)
        latency = self._latency + common[Common.LATENCY_ERROR]
        rolling = Signal(segments.time, motion.ground / (1.0 - motion.slip))
        return rolling.mean(segments.begin - latency, segments.end - latency)

    def motion(self, common: Array, initial_speeds: Array, biases: Array,
               linear_force: Array | None = None) -> Motion:
        """Return the predicted motion at each IMU sample."""
        segments, robot = self.segments, self._robot
        index = segments.sample_segment
        bias = biases[index]
        ground = initial_speeds[index] + segments.speed_gain - bias * segments.elapsed
        acceleration, direction = segments.force - bias, np.sign(ground)
        force = robot.mass * (acceleration + GRAVITY * common[Common.DRAG] * direction)
        if linear_force is None:
            loads = normal_loads(robot.mass, robot.center_of_mass, robot.wheelbase,
                                 robot.track_width, acceleration, 0.0, radius=robot.wheel_radius)
            linear_force = linear_tire_force(force, math.exp(common[Common.FRICTION]), loads.T)
        compliance = common[Common.COMPLIANCE] / robot.tire.longitudinal_stiffness
        slip = compliance * linear_force * direction + common[Common.RADIUS_ERROR]
        return Motion(ground, np.clip(slip, -MAX_SLIP, MAX_SLIP), force * direction, linear_force)

    def derivatives(self, common: Array, initial_speeds: Array,
                    biases: Array) -> tuple[Array, Array, Array]:
        """
        Return the derivatives of the wheel speeds.

        Columns (n, 5) by the common parameters, then (n,) each by initial speed and bias of the
        interval's own segment.
        """
        def central(step: float, common_step: Array, speed_step: float, bias_step: float,
                    linear_force: Array | None) -> Array:
            upper, lower = (
                self.speeds(common + sign * common_step, initial_speeds + sign * speed_step,
                            biases + sign * bias_step, linear_force) for sign in (1.0, -1.0))
            return (upper - lower) / (2.0 * step)

        linear_force = self.motion(common, initial_speeds, biases).linear_force
        no_step = np.zeros(len(Common))
        columns = [central(step, step * np.eye(len(Common))[row], 0.0, 0.0,
                           linear_force if row in FORCE_INDEPENDENT else None)
                   for row, step in zip(Common, COMMON_STEPS)]
        return (np.column_stack(columns),
                central(SEGMENT_STEP, no_step, SEGMENT_STEP, 0.0, linear_force),
                central(SEGMENT_STEP, no_step, 0.0, SEGMENT_STEP, None))
