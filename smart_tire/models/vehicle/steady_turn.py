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
Slip velocities of a skid-steer robot in a steady turn on brush tires.

A side is represented by its two wheels, which slide laterally by the same amount to opposite
sides. Forces are divided by the stiffness C_x of a tire, so the ground enters by ratios only: the
slip at which the tires balance the rolling resistance, and the critical slip. Plain floats, for a
controller at 20 Hz.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

ITERATIONS = 25        # of the fixed point; the error is then below 1 % of the slip velocity
RELAXATION = 0.6       # share of each iteration that is applied
MIN_SPEED = 0.02       # m/s, lower limit of speeds in a denominator
MAX_SLIDING = 5.0      # slip velocity over the largest speed of a wheel center, at most
TANGENT = 0.7          # of lambda_cr, above which the force grows along its tangent


@dataclass(frozen=True)
class TurnModel:
    """Geometry [m] of the robot, and lambda_cr of its tires."""

    wheelbase: float
    track: float
    critical_slip: float


@dataclass(frozen=True)
class SteadyTurn:
    """Slip velocities r w - v_x [m/s] of both sides, and the lateral compliance [m/s]."""

    left: float
    right: float
    lateral_compliance: float  # lateral speed per lateral force, the force divided by C_x


def steady_turn(model: TurnModel, v_x: float, yaw_rate: float, resistance: tuple[float, float],
                scrub: float = 1.0, thrust: float = 0.0) -> SteadyTurn:
    """
    Return the slip velocities that a body velocity [m/s], [rad/s] needs.

    ``resistance`` [-] is the slip of the left and of the right side when driving straight on;
    ``scrub`` is the moment against turning relative to that of an isotropic brush tire,
    ``thrust`` [-] the force of a wheel, over C_x, that accelerates the body. Above ``TANGENT`` the
    force is larger than that of the brush model, so that the slip remains finite and depends on
    all arguments near the limit of friction, too; it is at most ``MAX_SLIDING``.

    >>> turn = steady_turn(TurnModel(0.26, 0.38, 0.7), 0.5, 0.5, (0.0, 0.0))
    >>> print(f'{turn.left:.3f} {turn.right:.3f} m/s')
    -0.036 0.058 m/s
    """
    half = 0.5 * model.track * yaw_rate
    ground = v_x - half, v_x + half
    lateral = 0.5 * model.wheelbase * abs(yaw_rate)
    limit = MAX_SLIDING * max(map(abs, ground))
    inverse = [1.0 / max(math.hypot(v, lateral), MIN_SPEED) for v in ground]
    lever = 0.25 * model.wheelbase ** 2 / model.track * yaw_rate
    dragging = sum(part * one for part, one in zip(resistance, inverse))
    drag = [part * v * one for part, v, one in zip(resistance, ground, inverse)]
    sliding = [0.0, 0.0]
    grip = _grips(model, ground, sliding, lateral)
    for _ in range(ITERATIONS):
        moment = scrub * lever * (sum(grip) + dragging)
        for i, side in enumerate((-1.0, 1.0)):
            wanted = (drag[i] + thrust + side * moment) / grip[i]
            wanted = sliding[i] + RELAXATION * (wanted - sliding[i])
            sliding[i] = min(max(wanted, -limit), limit)
        grip = _grips(model, ground, sliding, lateral)
    return SteadyTurn(sliding[0], sliding[1], 0.5 / (sum(grip) + dragging))


def _grips(model: TurnModel, ground: tuple[float, float], sliding: list[float],
           lateral: float) -> list[float]:
    """Return the force per sliding speed [s/m] of a wheel of each side, divided by C_x."""
    grips = []
    for v, u in zip(ground, sliding):
        rolling, speed = max(abs(v + u), MIN_SPEED), math.hypot(u, lateral)
        grips.append(_share(speed / (rolling * model.critical_slip)) / rolling)
    return grips


def _share(t: float) -> float:
    """Return the force over C_x and slip, for a slip ``t`` in units of lambda_cr."""
    if t < TANGENT:
        return 1.0 - t + t * t / 3.0
    at_tangent = TANGENT * (1.0 - TANGENT + TANGENT * TANGENT / 3.0)
    return (at_tangent + (1.0 - TANGENT) ** 2 * (t - TANGENT)) / t
