"""
Planar dynamics of the skid-steered robot: rigid body, four driven wheels, brush tires.

The inner loop is in plain floats: for four wheels numpy's overhead would be most of a step.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

from smart_tire.models.vehicle.skid_steer import END, normal_loads, SIDE
from smart_tire.parameters.robot import RobotParams
from smart_tire.parameters.simulation import DriveParams
from smart_tire.samples import WHEELS
from smart_tire.simulation.surfaces import Ground, Surface

STEP_NS = 1_000_000  # ns
STEP = 1e-9 * STEP_NS
LOAD_LAG = 0.02      # s, time constant of load transfer: the vertical compliance of the tires
REST_SPEED = 0.02    # m/s, below it dry friction and drag are linear: no chatter at standstill


class Plant:
    """
    The robot's true state; ``step`` advances it by ``STEP``.

    Pose and velocity are those of ``base_link``, vectors in body axes, lists in the order of
    ``WHEELS``. The denominator of the slip is at least ``slip_floor`` [m/s], just so large that
    explicit steps do not overshoot; above it the brush tire is exact.
    """

    def __init__(self, robot: RobotParams, drive: DriveParams, ground: Ground,
                 start: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        self._robot, self._drive, self._ground = robot, drive, ground
        self.steps = 0
        self.start = tuple(start)                       # m, m, rad: odom in the world
        self.x, self.y, self.yaw = start                # m, m, rad: in the world
        self.v_x = self.v_y = self.yaw_rate = 0.0       # m/s, m/s, rad/s
        self.acceleration = (0.0, 0.0)                  # m/s2, of the centre of mass over ground
        self.yaw_acceleration = 0.0                     # rad/s2
        self.wheel_speed = [0.0] * 4                    # rad/s
        self.wheel_angle = [0.0] * 4                    # rad
        self.wheel_v_x = [0.0] * 4                      # m/s, of the wheels' centres
        self.wheel_v_y = [0.0] * 4                      # m/s
        self.load = [0.0] * 4                           # N
        self.surface: list[Surface] = [ground.at(self.x, self.y)] * 4
        self._felt = (0.0, 0.0)                         # m/s2, acceleration the loads follow
        self._wheel_x = [0.5 * robot.wheelbase * float(end) for end in END]
        self._wheel_y = [0.5 * robot.track_width * float(side) for side in SIDE]
        self._load_map = self._linear_loads()
        self.slip_floor = self._stable_floor()
        self._stand()

    @property
    def time_ns(self) -> int:
        """Return the time since the start [ns]."""
        return self.steps * STEP_NS

    def step(self, duty: Sequence[float]) -> None:
        """Advance by one step under the motors' duties, -1 to 1."""
        com_x, com_y, _ = self._robot.center_of_mass
        sum_x = sum_y = torque = 0.0
        for i in range(len(WHEELS)):
            f_x, f_y = self._turn_wheel(i, duty[i])
            sum_x += f_x
            sum_y += f_y
            torque += (self._wheel_x[i] - com_x) * f_y - (self._wheel_y[i] - com_y) * f_x
        self.acceleration = (sum_x / self._robot.mass, sum_y / self._robot.mass)
        self.yaw_acceleration = torque / self._robot.yaw_inertia
        self._move()
        self._stand()
        self.steps += 1

    def _turn_wheel(self, i: int, duty: float) -> tuple[float, float]:
        """
        Advance wheel ``i`` and return the force [N] of the ground on the robot there.

        Implicit in the wheel's speed, for the tire holds a light wheel too stiffly for a step.
        """
        drive, radius, surface = self._drive, self._robot.wheel_radius, self.surface[i]
        speed, load = self.wheel_speed[i], self.load[i]
        v_x, v_y = self.wheel_v_x[i], self.wheel_v_y[i]
        scale = 1.0 / max(abs(radius * speed), self.slip_floor)
        slip = math.hypot(radius * speed - v_x, v_y) * scale
        grip = scale * force_slope(slip, surface.friction, load, surface.stiffness)  # N s/m
        resistance = (drive.stall_torque / drive.free_speed
                      + drive.friction / max(abs(speed), REST_SPEED / radius))  # N m s
        new_speed = ((drive.inertia * speed + STEP * (drive.stall_torque * duty
                                                      + radius * grip * v_x))
                     / (drive.inertia + STEP * (resistance + radius * radius * grip)))
        self.wheel_speed[i] = new_speed
        self.wheel_angle[i] += 0.5 * STEP * (speed + new_speed)
        drag = surface.drag * load / max(math.hypot(v_x, v_y), REST_SPEED)  # N s/m
        return grip * (radius * new_speed - v_x) - drag * v_x, -(grip + drag) * v_y

    def _move(self) -> None:
        """Advance velocity and pose; exact for a body without forces."""
        com_x, com_y, _ = self._robot.center_of_mass
        old_x, old_y, old_rate = self.v_x, self.v_y, self.yaw_rate
        pushed_x = old_x - old_rate * com_y + STEP * self.acceleration[0]
        pushed_y = old_y + old_rate * com_x + STEP * self.acceleration[1]
        self.yaw_rate += STEP * self.yaw_acceleration
        turn = 0.5 * STEP * (old_rate + self.yaw_rate)
        cos, sin = math.cos(turn), math.sin(turn)
        self.v_x = cos * pushed_x + sin * pushed_y + self.yaw_rate * com_y
        self.v_y = cos * pushed_y - sin * pushed_x - self.yaw_rate * com_x
        middle = self.yaw + 0.5 * turn
        cos, sin = 0.5 * STEP * math.cos(middle), 0.5 * STEP * math.sin(middle)
        self.x += cos * (old_x + self.v_x) - sin * (old_y + self.v_y)
        self.y += sin * (old_x + self.v_x) + cos * (old_y + self.v_y)
        self.yaw += turn

    def _stand(self) -> None:
        """Read what follows from the state: wheel velocities, surfaces and loads."""
        follow = STEP / (LOAD_LAG + STEP)
        felt_x = self._felt[0] + follow * (self.acceleration[0] - self._felt[0])
        felt_y = self._felt[1] + follow * (self.acceleration[1] - self._felt[1])
        self._felt = (felt_x, felt_y)
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        for i, (static, per_x, per_y) in enumerate(self._load_map):
            x, y = self._wheel_x[i], self._wheel_y[i]
            self.wheel_v_x[i] = self.v_x - y * self.yaw_rate
            self.wheel_v_y[i] = self.v_y + x * self.yaw_rate
            self.surface[i] = self._ground.at(self.x + cos * x - sin * y,
                                              self.y + sin * x + cos * y)
            self.load[i] = max(static + per_x * felt_x + per_y * felt_y, 0.0)

    def _linear_loads(self) -> list[tuple[float, float, float]]:
        """Return each wheel's load [N] at rest and its change per m/s2 along x and y."""
        robot = self._robot
        loads = normal_loads(
            robot.mass, robot.center_of_mass, robot.wheelbase, robot.track_width,
            [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], radius=robot.wheel_radius)
        return [(float(rest), float(x - rest), float(y - rest)) for rest, x, y in loads.T]

    def _stable_floor(self) -> float:
        """Return the denominator [m/s] at which a step just cancels the fastest mode's slip."""
        robot = self._robot
        stiffness = max(surface.stiffness for surface in self._ground.surfaces.values())
        com_x, com_y, _ = robot.center_of_mass
        arms = sum((x - com_x)**2 + (y - com_y)**2 for x, y in zip(self._wheel_x, self._wheel_y))
        return STEP * stiffness * (4.0 / robot.mass + arms / robot.yaw_inertia)


def force_slope(total_slip: float, mu: float, load: float, stiffness: float) -> float:
    """Return brush_tire.brush_force over the slip [N]: the same law for plain floats."""
    limit = mu * load
    share = stiffness * total_slip
    if share < 3.0 * limit:
        t = share / (3.0 * limit)
        return stiffness * (1.0 - t + t * t / 3.0)
    return limit / total_slip if total_slip > 0.0 else 0.0
