"""
How fast the wheels must turn for a robot on a straight line to accelerate as it does.

``m a + drag = sum of brush forces(slip)``, read backwards: from the acceleration follows the
force, from the force the slip, from slip and speed over ground the wheels' speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.recording import Signal
from smart_tire.calibration.tire.straight_segments import StraightRuns
from smart_tire.models.tire.shared_slip import stiff_slip
from smart_tire.models.vehicle.skid_steer import GRAVITY, normal_loads
from smart_tire.parameters import RobotParams


LARGEST_SLIP = 0.5  # -, either way; beyond, wheels slide and speeds mean nothing
RUN_STEP = 0.01     # m/s and m/s2, for derivatives by what belongs to a run


class Common(IntEnum):
    """Parameters that all runs share; those of each run follow: speeds, then biases."""

    COMPLIANCE = 0  # -, C_x as given over C_x
    DRAG = 1        # of the weight, against the motion
    FRICTION = 2    # -, ln of mu
    LATENESS = 3    # s, of the wheels' stamps beyond the latency that is known
    ROLLING = 4     # -, slip that needs no force: an error of the rolling radius


AT_EQUAL_FORCES = {Common.COMPLIANCE, Common.LATENESS, Common.ROLLING}  # which they leave alone
STEPS = (5e-3, 5e-4, 0.02, 2e-4, 1e-3)  # in the order of ``Common``, for derivatives


@dataclass(frozen=True)
class Motion:
    """What parameters make of the readings of the inertial unit, shape (m,) each."""

    ground: Array  # m/s, speed over ground
    slip: Array    # -, B(3)'s lambda of all wheels
    force: Array   # N, of all wheels together, positive when driving
    stiff: Array   # N, C_x times the slip, positive when pushing forward


class StiffnessModel:
    """The straight runs of one recording and what parameters make of them."""

    def __init__(self, runs: StraightRuns, robot: RobotParams) -> None:
        self.runs, self._robot = runs, robot
        self._latency = robot.encoder.latency

    def speeds(self, common: Array, first: Array, biases: Array,
               stiff: Array | None = None) -> Array:
        """
        Return the wheels' mean speeds [m/s] in all stretches (n,).

        ``first`` [m/s] is the speed over ground with which each run began, ``biases`` [m/s2] what
        the accelerometer felt too much in it; ``stiff`` (m,) [N] is C_x times the slip, where that
        is known already.
        """
        motion, runs = self.motion(common, first, biases, stiff), self.runs
        late = self._latency + common[Common.LATENESS]
        rolling = Signal(runs.time, motion.ground / (1.0 - motion.slip))
        return rolling.mean(runs.begin - late, runs.end - late)

    def motion(self, common: Array, first: Array, biases: Array,
               stiff: Array | None = None) -> Motion:
        """Return what the parameters make of each reading."""
        runs, robot = self.runs, self._robot
        bias = biases[runs.reading_run]
        ground = first[runs.reading_run] + runs.gained - bias * runs.lasted
        acceleration, ahead = runs.force - bias, np.sign(ground)
        force = robot.mass * (acceleration + GRAVITY * common[Common.DRAG] * ahead)
        if stiff is None:
            loads = normal_loads(robot.mass, robot.center_of_mass, robot.wheelbase,
                                 robot.track_width, acceleration, 0.0, radius=robot.wheel_radius)
            stiff = stiff_slip(force, math.exp(common[Common.FRICTION]), loads.T)
        compliance = common[Common.COMPLIANCE] / robot.tire.longitudinal_stiffness
        slip = compliance * stiff * ahead + common[Common.ROLLING]
        return Motion(ground, np.clip(slip, -LARGEST_SLIP, LARGEST_SLIP), force * ahead, stiff)

    def slopes(self, common: Array, first: Array, biases: Array) -> tuple[Array, Array, Array]:
        """
        Return how the speeds follow the parameters.

        Columns (n, 5) by what is common, and by first speed and bias of the own run, (n,) each.
        """
        def central(step: float, common_by: Array, first_by: float, bias_by: float,
                    stiff: Array | None) -> Array:
            up, down = (self.speeds(common + side * common_by, first + side * first_by,
                                    biases + side * bias_by, stiff) for side in (1.0, -1.0))
            return (up - down) / (2.0 * step)

        stiff, still = self.motion(common, first, biases).stiff, np.zeros(len(Common))
        columns = [central(step, step * np.eye(len(Common))[row], 0.0, 0.0,
                           stiff if row in AT_EQUAL_FORCES else None)
                   for row, step in zip(Common, STEPS)]
        return (np.column_stack(columns), central(RUN_STEP, still, RUN_STEP, 0.0, stiff),
                central(RUN_STEP, still, 0.0, RUN_STEP, None))
