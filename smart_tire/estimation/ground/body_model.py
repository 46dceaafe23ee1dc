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
Motion of the robot on brush tires for given wheel speeds.

The robot is a planar rigid body. The state is the velocity (u, v) [m/s] of its center of mass in
body axes and the yaw rate w [rad/s]. With the slip ``s = (r w_i - v_x, -k v_y) / |r w_i|`` of a
wheel, ``k = C_y / C_x`` and ``t = C_x |s| / (3 mu F_z)``, its force is
``C_x (1 - t + t^2 / 3) s`` below full sliding (t < 1) and ``mu F_z s / |s|`` above. Its rolling
resistance ``f F_z`` acts along the velocity of its center by the lateral share and along its
heading by the rest (PHYSICS.md D). Loads follow the acceleration of the step before.

Steps are implicit, by the second backward differentiation formula, with the secant slope
``|F| / |s|`` at the extrapolated velocity: stable at any speed, where explicit steps of a
millisecond would be needed close to standstill.

Python as it stands, and compiled by Cython where a compiler is found: ``body_model_numpy`` has
the same equations for many runs at once.
"""

# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False

import cython
from cython.cimports.libc.math import sqrt

COMPILED = cython.compiled

# parameters of a run; those of the ground before and after its change at CHANGE_STEP
(OLD_STIFFNESS, OLD_FRICTION, OLD_RESISTANCE, STIFFNESS, FRICTION, RESISTANCE, CHANGE_STEP,
 LATERAL_SHARE, LATERAL_RATIO, COM_X, COM_Y, RADIUS, SLOPE_X, SLOPE_Y, SIDE_STIFFNESS,
 SIDE_FRICTION, SIDE_RESISTANCE, START_U, START_V, START_W) = range(20)
PARAMETERS = 20
# constants of the robot: step [s], mass [kg], yaw inertia [kg m2], half wheelbase and track [m],
# height of the center of mass [m], least speeds [m/s] of slip and of resistance, gravity [m/s2]
STEP, MASS, INERTIA, HALF_BASE, HALF_TRACK, HEIGHT, SLIP_FLOOR, DRAG_FLOOR, GRAVITY = range(9)
# output of a step: velocity, acceleration of the center of mass by forces, angular acceleration,
# tread forces along x of the wheels
U, V, W, A_X, A_Y, W_DOT, FORCE = range(7)
OUTPUTS = 10


@cython.ccall
def simulate(rolling: cython.double[:, ::1], offsets: cython.double[:, :, ::1],
             heading: cython.double[:, ::1], runs: cython.double[:, ::1],
             robot: cython.double[::1], out: cython.double[:, :, ::1]) -> cython.void:
    """
    Simulate all runs over n steps.

    ``rolling`` (n, 4): r w [m/s] of the wheels at the end of each step, by the nominal radius.
    ``offsets`` (runs, n, 2): added to r w of the left and of the right side [m/s].
    ``heading`` (n, 2): cosine and sine of the heading in the frame of the slopes.
    ``runs`` (runs, PARAMETERS): C_x [N], mu, f, their ratios of the left side to the mean, and so
    on. ``robot``: constants. ``out`` (runs, n, OUTPUTS) is filled.
    """
    i: cython.Py_ssize_t
    for i in range(runs.shape[0]):
        _simulate_run(rolling, offsets[i], heading, runs[i], robot, out[i])


@cython.cfunc
@cython.exceptval(check=False)
def _load(i: cython.int, p: cython.double[::1], robot: cython.double[::1], a_x: cython.double,
          a_y: cython.double) -> cython.double:
    """Return the load [N] of wheel ``i`` on level ground, 0 if it is lifted."""
    pitch: cython.double = (robot[GRAVITY] * p[COM_X] - robot[HEIGHT] * a_x) / robot[HALF_BASE]
    roll: cython.double = (robot[GRAVITY] * p[COM_Y] - robot[HEIGHT] * a_y) / robot[HALF_TRACK]
    return max(0.25 * robot[MASS] * (robot[GRAVITY] + (pitch if i < 2 else -pitch)
                                     + (roll if i % 2 == 0 else -roll)), 0.0)


@cython.cfunc
@cython.exceptval(check=False)
def _secant(total: cython.double, stiffness: cython.double, limit: cython.double
            ) -> cython.double:
    """Return |F| / |s| [N] of the brush model; ``limit`` is mu F_z [N]."""
    t: cython.double
    if stiffness * total >= 3.0 * limit:
        return limit / max(total, 1e-9)
    t = stiffness * total / (3.0 * limit)
    return stiffness * (1.0 - t + t * t / 3.0)


@cython.cfunc
@cython.exceptval(check=False)
def _simulate_run(rolling: cython.double[:, ::1], offset: cython.double[:, ::1],
                  heading: cython.double[:, ::1], p: cython.double[::1],
                  robot: cython.double[::1], out: cython.double[:, ::1]) -> cython.void:
    step: cython.double = robot[STEP]
    mass: cython.double = robot[MASS]
    u: cython.double = p[START_U]
    v: cython.double = p[START_V]
    w: cython.double = p[START_W]
    last_u: cython.double = u
    last_v: cython.double = v
    last_w: cython.double = w
    a_x: cython.double = 0.0
    a_y: cython.double = 0.0
    new_u: cython.double
    new_v: cython.double
    new_w: cython.double
    n: cython.Py_ssize_t
    i: cython.int
    ground: cython.int
    grip: cython.double[4]
    for n in range(rolling.shape[0]):
        # y' = (rate y - old_y): BDF2, in the first step Euler
        rate: cython.double = (1.5 if n else 1.0) / step
        old_u: cython.double = (2.0 * u - 0.5 * last_u if n else u) / step
        old_v: cython.double = (2.0 * v - 0.5 * last_v if n else v) / step
        old_w: cython.double = (2.0 * w - 0.5 * last_w if n else w) / step
        new_u, new_v, new_w = 2.0 * u - last_u, 2.0 * v - last_v, 2.0 * w - last_w
        slope_x: cython.double = robot[GRAVITY] * (
            heading[n, 0] * p[SLOPE_X] + heading[n, 1] * p[SLOPE_Y])
        slope_y: cython.double = robot[GRAVITY] * (
            heading[n, 0] * p[SLOPE_Y] - heading[n, 1] * p[SLOPE_X])
        # symmetric equations of the new velocity: [uu 0 uw; 0 vv vw; uw vw ww] y = (bu, bv, bw)
        uu: cython.double = mass * rate
        vv: cython.double = mass * rate
        ww: cython.double = robot[INERTIA] * rate
        uw: cython.double = 0.0
        vw: cython.double = 0.0
        bu: cython.double = mass * (old_u + new_w * new_v - slope_x)
        bv: cython.double = mass * (old_v - new_w * new_u - slope_y)
        bw: cython.double = robot[INERTIA] * old_w
        ground = OLD_STIFFNESS if n < p[CHANGE_STEP] else STIFFNESS
        for i in range(4):
            x: cython.double = (robot[HALF_BASE] if i < 2 else -robot[HALF_BASE]) - p[COM_X]
            y: cython.double = (
                robot[HALF_TRACK] if i % 2 == 0 else -robot[HALF_TRACK]) - p[COM_Y]
            left: cython.bint = i % 2 == 0
            stiffness: cython.double = p[ground] * (
                p[SIDE_STIFFNESS] if left else 1.0 / p[SIDE_STIFFNESS])
            friction: cython.double = p[ground + 1] * (
                p[SIDE_FRICTION] if left else 1.0 / p[SIDE_FRICTION])
            load: cython.double = _load(i, p, robot, a_x, a_y)
            drag: cython.double = p[ground + 2] * load * (
                p[SIDE_RESISTANCE] if left else 1.0 / p[SIDE_RESISTANCE])
            roll: cython.double = p[RADIUS] * rolling[n, i] + offset[n, i % 2]
            v_x: cython.double = new_u - y * new_w
            v_y: cython.double = new_v + x * new_w
            scale: cython.double = 1.0 / max(abs(roll), robot[SLIP_FLOOR])
            s_x: cython.double = (roll - v_x) * scale
            s_y: cython.double = p[LATERAL_RATIO] * v_y * scale
            grip[i] = scale * _secant(sqrt(s_x * s_x + s_y * s_y), stiffness, friction * load)
            drag_y: cython.double = p[LATERAL_SHARE] * drag / max(
                sqrt(v_x * v_x + v_y * v_y), robot[DRAG_FLOOR])
            along: cython.double = grip[i] + drag_y + (
                1.0 - p[LATERAL_SHARE]) * drag / max(abs(v_x), robot[DRAG_FLOOR])
            across: cython.double = p[LATERAL_RATIO] * grip[i] + drag_y
            uu += along
            uw -= along * y
            vv += across
            vw += across * x
            ww += across * x * x + along * y * y
            bu += grip[i] * roll
            bw -= y * grip[i] * roll
        new_w = (bw - uw * bu / uu - vw * bv / vv) / (ww - uw * uw / uu - vw * vw / vv)
        new_u = (bu - uw * new_w) / uu
        new_v = (bv - vw * new_w) / vv
        a_x = rate * new_u - old_u - new_w * new_v + slope_x
        a_y = rate * new_v - old_v + new_w * new_u + slope_y
        out[n, U], out[n, V], out[n, W] = new_u, new_v, new_w
        out[n, A_X], out[n, A_Y], out[n, W_DOT] = a_x, a_y, rate * new_w - old_w
        for i in range(4):
            out[n, FORCE + i] = grip[i] * (
                p[RADIUS] * rolling[n, i] + offset[n, i % 2] - new_u
                + ((robot[HALF_TRACK] if i % 2 == 0 else -robot[HALF_TRACK]) - p[COM_Y]) * new_w)
        last_u, last_v, last_w = u, v, w
        u, v, w = new_u, new_v, new_w
