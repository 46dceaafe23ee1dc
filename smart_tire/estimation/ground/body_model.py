# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

# cython: language_level=3, boundscheck=False, wraparound=False, initializedcheck=False
# cython: cdivision=True, show_performance_hints=False

"""
Motion of the robot on brush tires for given wheel speeds.

The robot is a planar rigid body. The state is the velocity (u, v) [m/s] of its center of mass in
body axes and the yaw rate w [rad/s]. Tire forces are those of ``models/tire/brush_tire``, with a
slip s that follows over the relaxation length l: ``l s' = (r w_i - v_x, -k v_y) - |r w_i| s``,
without a singularity at rest; a sliding tire deflects no further. The rolling resistance
``f F_z`` acts along the velocity of the wheel center by the lateral share and along its heading by
the rest (PHYSICS.md D). Loads follow the acceleration of the step before. A lifted wheel has none.
Of the load that it loses, the wheel across from it gets the share k, the other two -k: with k = -1
they carry the weight and its moments alone.

Steps are implicit, by the second backward differentiation formula, with the secant slope
``|F| / |s|`` at the extrapolated velocity: stable at any speed, where explicit steps of a
millisecond would be needed close to standstill.

This is plain Python; ``setup.py`` compiles it with Cython where there is a compiler. Without one,
numpy computes the same with arrays over all runs in place of numbers.
"""

from __future__ import annotations

import numpy as np

try:
    import cython
except ImportError:
    from smart_tire.numerics import uncompiled as cython

if cython.compiled:
    from cython.cimports.libc.math import fabs, sqrt
    from cython.cimports.smart_tire.models.tire.brush_tire import friction_share, secant
else:
    from numpy import absolute as fabs, maximum as max, minimum as min, sqrt  # noqa: A001, A004
    from smart_tire.models.tire.brush_tire import friction_share, secant

COMPILED: bool = cython.compiled

# parameters of a run, to START_W in the order of ``unknowns.Unknown``, with RELAXATION for DELAY;
# those of two grounds: OLD_ is the first one, from step NEW on it is the second
(STIFFNESS, FRICTION, RESISTANCE, OLD_STIFFNESS, OLD_FRICTION, OLD_RESISTANCE,
 LATERAL_SHARE, LATERAL_RATIO, COM_X, COM_Y, RADIUS, SLOPE_X, SLOPE_Y, SIDE_STIFFNESS,
 SIDE_FRICTION, SIDE_RESISTANCE, RELAXATION, FALL, MOVED_LOAD, BEND_X, BEND_Y, START_U, START_V,
 START_W, NEW, _, _, _, LIFT, _, _, _, _, _, PARAMETERS) = range(35)
# NEW: of the left and of the right side the steps from which, and until which, its ground is the
# second one; then of each of two lifts: index of the wheel, steps of its begin and end
# constants of the robot: step [s], mass [kg], yaw inertia [kg m2], half wheelbase and track [m],
# height of the center of mass [m], least speeds [m/s] of slip and of resistance, gravity [m/s2]
TIME_STEP, MASS, INERTIA, HALF_BASE, HALF_TRACK, HEIGHT, SLIP_FLOOR, DRAG_FLOOR, GRAVITY = range(9)
# output of a step: velocity, acceleration of the center of mass by forces, angular acceleration,
# tread forces along x of the wheels, and their loads
U, V, W, A_X, A_Y, W_DOT, FORCE, _, _, _, LOADS, _, _, _, OUTPUTS = range(15)
# means over a crossing; LOSS is the product of the shares of the friction that are left
SLIP, NORMALIZED, LOAD, TRACTION, LOSS, VALUES = range(6)


def simulate(rolling: cython.double[:, ::1], offsets: cython.double[:, :, ::1],
             heading: cython.double[:, ::1], runs: cython.double[:, ::1],
             robot: cython.double[::1], out: cython.double[:, :, ::1]) -> None:
    """
    Simulate all runs over n steps.

    ``rolling`` (n, 4): r w [m/s] of the wheels at the end of each step, by the nominal radius.
    ``offsets`` (runs, n, 2): added to r w of the left and of the right side [m/s].
    ``heading`` (n, 2): cosine and sine of the heading in the frame of the slopes.
    ``runs`` (runs, PARAMETERS): C_x [N], mu, f, their ratios of the left side to the mean, and so
    on. ``robot``: constants. ``out`` (runs, n, OUTPUTS) is filled. Raise ValueError where shapes
    disagree.
    """
    n: cython.Py_ssize_t = rolling.shape[0]
    count: cython.Py_ssize_t = runs.shape[0]
    run: cython.Py_ssize_t
    if not (rolling.shape[1] == 4 and heading.shape[0] == n and heading.shape[1] == 2
            and runs.shape[1] == PARAMETERS and robot.shape[0] == GRAVITY + 1
            and offsets.shape[0] == count and offsets.shape[1] == n and offsets.shape[2] == 2
            and out.shape[0] == count and out.shape[1] == n and out.shape[2] == OUTPUTS):
        raise ValueError('the shapes of the arrays disagree')
    if not cython.compiled:  # offset (n, 2, runs), p (PARAMETERS, runs), out (n, OUTPUTS, runs)
        _simulate_run(rolling, np.moveaxis(offsets, 0, -1), heading, runs.T, robot,
                      np.moveaxis(out, 0, -1))
        return
    for run in range(count):
        _simulate_run(rolling, offsets[run], heading, runs[run], robot, out[run])


@cython.cfunc
@cython.exceptval(check=False)
def _load(level: cython.double, by_x: cython.double, by_y: cython.double, a_x: cython.double,
          a_y: cython.double) -> cython.double:
    """Return the load [N] from that at rest, of all wheels; below 0: they would pull."""
    return level - by_x * a_x - by_y * a_y


@cython.cfunc
@cython.exceptval(check=False)
def _inside(n: cython.double, begin: cython.double, end: cython.double) -> cython.double:
    """Return 1 if step ``n`` is one from ``begin`` until ``end``, else 0."""
    return min(max(n + 1.0 - begin, 0.0), 1.0) - min(max(n + 1.0 - end, 0.0), 1.0)


@cython.cfunc
def _simulate_run(rolling: cython.double[:, ::1], offset: cython.double[:, ::1],
                  heading: cython.double[:, ::1], p: cython.double[::1],
                  robot: cython.double[::1], out: cython.double[:, ::1]) -> cython.void:
    """Simulate one run; what its steps have in common is computed before them."""
    frequency: cython.double = 1.0 / robot[TIME_STEP]
    mass: cython.double = robot[MASS]
    inertia: cython.double = robot[INERTIA]
    min_rolling: cython.double = robot[SLIP_FLOOR]
    min_speed: cython.double = robot[DRAG_FLOOR]
    gravity: cython.double = robot[GRAVITY]
    steps: cython.double = rolling.shape[0]
    share: cython.double = p[LATERAL_SHARE]
    lateral_ratio: cython.double = p[LATERAL_RATIO]
    radius: cython.double = p[RADIUS]
    fall: cython.double = p[FALL]
    relaxation: cython.double = p[RELAXATION]
    # of the wheels: position [m], load at rest [N] and by acceleration [kg], share that it gets of
    # the load that is lost in each lift, ground before its
    # change and (4-7) the change, r w [m/s], slip, |F| / |s| [N], change of the slip by the new
    # velocity [s/m], and of the force [N s/m], share of the slip that is stored, in a step; 1 on
    # the second ground, else 0, rolling resistance [N], velocity of the center [m/s], stiffness
    # [N] and normalized slip up to 1
    x: cython.double[4] = [0.0] * 4
    y: cython.double[4] = [0.0] * 4
    level: cython.double[4] = [0.0] * 4
    by_x: cython.double[4] = [0.0] * 4
    by_y: cython.double[4] = [0.0] * 4
    gets: cython.double[8] = [0.0] * 8
    # of the lifted wheels: load at rest [N] and by acceleration [kg]
    own_level: cython.double[2] = [0.0] * 2
    own_x: cython.double[2] = [0.0] * 2
    own_y: cython.double[2] = [0.0] * 2
    stiffness: cython.double[8] = [0.0] * 8
    friction: cython.double[8] = [0.0] * 8
    resistance: cython.double[8] = [0.0] * 8
    roll: cython.double[4] = [0.0] * 4
    slip_x: cython.double[4] = [0.0] * 4
    slip_y: cython.double[4] = [0.0] * 4
    slope: cython.double[4] = [0.0] * 4
    gain: cython.double[4] = [0.0] * 4
    grip: cython.double[4] = [0.0] * 4
    kept: cython.double[4] = [0.0] * 4
    after: cython.double[4] = [1.0] * 4
    drag: cython.double[4] = [0.0] * 4
    v_x: cython.double[4] = [0.0] * 4
    v_y: cython.double[4] = [0.0] * 4
    stiff: cython.double[4] = [0.0] * 4
    t: cython.double[4] = [0.0] * 4
    i: cython.int
    k: cython.int
    for i in range(4):
        left: cython.bint = i % 2 == 0
        base: cython.double = robot[HALF_BASE] if i < 2 else -robot[HALF_BASE]
        track: cython.double = robot[HALF_TRACK] if left else -robot[HALF_TRACK]
        x[i] = base - p[COM_X]
        y[i] = track - p[COM_Y]
        level[i] = 0.25 * mass * robot[GRAVITY] * (1.0 + p[COM_X] / base + p[COM_Y] / track)
        by_x[i] = 0.25 * mass * robot[HEIGHT] / base
        by_y[i] = 0.25 * mass * robot[HEIGHT] / track
        for k in range(2):
            diagonal: cython.double = max(1.0 - fabs(p[LIFT + 3 * k] - (3 - i)), 0.0)
            lost: cython.double = max(1.0 - fabs(p[LIFT + 3 * k] - i), 0.0)
            gets[4 * k + i] = p[MOVED_LOAD] * (2.0 * diagonal + lost - 1.0) - lost
            own_level[k] = own_level[k] + lost * level[i]
            own_x[k] = own_x[k] + lost * by_x[i]
            own_y[k] = own_y[k] + lost * by_y[i]
        side: cython.double = p[SIDE_STIFFNESS] if left else 1.0 / p[SIDE_STIFFNESS]
        stiffness[i] = side * p[OLD_STIFFNESS]
        stiffness[4 + i] = side * (p[STIFFNESS] - p[OLD_STIFFNESS])
        side = p[SIDE_FRICTION] if left else 1.0 / p[SIDE_FRICTION]
        friction[i] = side * p[OLD_FRICTION]
        friction[4 + i] = side * (p[FRICTION] - p[OLD_FRICTION])
        side = p[SIDE_RESISTANCE] if left else 1.0 / p[SIDE_RESISTANCE]
        resistance[i] = side * p[OLD_RESISTANCE]
        resistance[4 + i] = side * (p[RESISTANCE] - p[OLD_RESISTANCE])

    # runs in arrays are computed with both
    lifts: cython.bint = not cython.compiled or p[LIFT] >= 0.0 or p[LIFT + 3] >= 0.0
    changes: cython.bint = not cython.compiled or (
        p[NEW] > 0.0 or p[NEW + 2] > 0.0 or p[NEW + 1] < steps or p[NEW + 3] < steps)
    first: cython.double = 0.0
    second: cython.double = 0.0
    u: cython.double = p[START_U]
    v: cython.double = p[START_V]
    w: cython.double = p[START_W]
    last_u: cython.double = u
    last_v: cython.double = v
    last_w: cython.double = w
    a_x: cython.double = 0.0
    a_y: cython.double = 0.0
    n: cython.Py_ssize_t
    for n in range(rolling.shape[0]):
        # y' = (rate y - old_y): BDF2, in the first step Euler
        rate: cython.double = (1.5 if n else 1.0) * frequency
        old_u: cython.double = (2.0 * u - 0.5 * last_u if n else u) * frequency
        old_v: cython.double = (2.0 * v - 0.5 * last_v if n else v) * frequency
        old_w: cython.double = (2.0 * w - 0.5 * last_w if n else w) * frequency
        new_u: cython.double = 2.0 * u - last_u
        new_v: cython.double = 2.0 * v - last_v
        new_w: cython.double = 2.0 * w - last_w
        part: cython.double = (n + 0.5) / steps - 0.5  # of the window, from its middle
        gravity_x: cython.double = gravity * (p[SLOPE_X] + part * p[BEND_X])
        gravity_y: cython.double = gravity * (p[SLOPE_Y] + part * p[BEND_Y])
        slope_x: cython.double = heading[n, 0] * gravity_x + heading[n, 1] * gravity_y
        slope_y: cython.double = heading[n, 0] * gravity_y - heading[n, 1] * gravity_x
        # symmetric equations of the new velocity: [uu 0 uw; 0 vv vw; uw vw ww] y = (bu, bv, bw)
        uu: cython.double = mass * rate
        vv: cython.double = mass * rate
        ww: cython.double = inertia * rate
        uw: cython.double = 0.0
        vw: cython.double = 0.0
        bu: cython.double = mass * (old_u + new_w * new_v - slope_x)
        bv: cython.double = mass * (old_v - new_w * new_u - slope_y)
        bw: cython.double = inertia * old_w
        # the first step begins with the slip of its end
        lag: cython.double = relaxation * frequency if n else 0.0  # m/s
        if changes:
            after[0] = after[2] = _inside(n, p[NEW], p[NEW + 1])
            after[1] = after[3] = _inside(n, p[NEW + 2], p[NEW + 3])
        if lifts:
            first = _inside(n, p[LIFT + 1], p[LIFT + 2])
            second = _inside(n, p[LIFT + 4], p[LIFT + 5])
        one: cython.double = first * _load(own_level[0], own_x[0], own_y[0], a_x, a_y)  # N
        two: cython.double = second * _load(own_level[1], own_x[1], own_y[1], a_x, a_y)
        for i in range(4):  # apart from calls: the compiler computes wheels side by side
            load: cython.double = max(_load(level[i], by_x[i], by_y[i], a_x, a_y)
                                      + one * gets[i] + two * gets[4 + i], 0.0)
            drag[i] = load * (resistance[i] + after[i] * resistance[4 + i])
            roll[i] = radius * rolling[n, i] + offset[n, i % 2]
            v_x[i] = new_u - y[i] * new_w
            v_y[i] = new_v + x[i] * new_w
            gain[i] = 1.0 / (max(fabs(roll[i]), min_rolling) + lag)
            slip_x[i] = slip_x[i] * lag * gain[i]
            slip_y[i] = slip_y[i] * lag * gain[i]
            s_x: cython.double = slip_x[i] + gain[i] * (roll[i] - v_x[i])
            s_y: cython.double = slip_y[i] + gain[i] * lateral_ratio * v_y[i]
            stiff[i] = stiffness[i] + after[i] * stiffness[4 + i]
            full: cython.double = 3.0 * (load * (friction[i] + after[i] * friction[4 + i]))
            # N, without sliding; t = 1 at ``full``
            elastic: cython.double = stiff[i] * max(sqrt(s_x * s_x + s_y * s_y), 1e-9)
            scale: cython.double = 1.0 / max(elastic, full)
            kept[i] = full * scale  # a tire that slides deflects no further
            t[i] = elastic * scale
        for i in range(4):
            slope[i] = secant(t[i], kept[i], fall)
        for i in range(4):
            slope[i] = stiff[i] * slope[i]
            grip[i] = gain[i] * slope[i]
            drag_y: cython.double = share * drag[i] / max(
                sqrt(v_x[i] * v_x[i] + v_y[i] * v_y[i]), min_speed)
            along: cython.double = grip[i] + drag_y + (1.0 - share) * drag[i] / max(
                fabs(v_x[i]), min_speed)
            across: cython.double = lateral_ratio * grip[i] + drag_y
            force: cython.double = grip[i] * roll[i] + slope[i] * slip_x[i]
            uu += along
            uw -= along * y[i]
            vv += across
            vw += across * x[i]
            ww += across * x[i] * x[i] + along * y[i] * y[i]
            bu += force
            bv -= slope[i] * slip_y[i]
            bw -= y[i] * force + x[i] * slope[i] * slip_y[i]
        new_w = (bw - uw * bu / uu - vw * bv / vv) / (ww - uw * uw / uu - vw * vw / vv)
        new_u = (bu - uw * new_w) / uu
        new_v = (bv - vw * new_w) / vv
        a_x = rate * new_u - old_u - new_w * new_v + slope_x
        a_y = rate * new_v - old_v + new_w * new_u + slope_y
        one = first * _load(own_level[0], own_x[0], own_y[0], a_x, a_y)
        two = second * _load(own_level[1], own_x[1], own_y[1], a_x, a_y)
        # columns U to LOADS + 3 by their numbers: names of the module are slow here
        out[n, 0], out[n, 1], out[n, 2] = new_u, new_v, new_w
        out[n, 3], out[n, 4], out[n, 5] = a_x, a_y, rate * new_w - old_w
        for i in range(4):
            s_x = slip_x[i] + gain[i] * (roll[i] - new_u + y[i] * new_w)
            s_y = slip_y[i] + gain[i] * lateral_ratio * (new_v + x[i] * new_w)
            out[n, 6 + i] = slope[i] * s_x
            out[n, 10 + i] = max(_load(level[i], by_x[i], by_y[i], a_x, a_y)
                                 + one * gets[i] + two * gets[4 + i], 0.0)
            slip_x[i] = kept[i] * s_x
            slip_y[i] = kept[i] * s_y
        last_u, last_v, last_w = u, v, w
        u, v, w = new_u, new_v, new_w


def average_crossings(states: cython.double[:, :, ::1], rolling: cython.double[:, :, ::1],
                      after: cython.double[:, ::1], steps: cython.Py_ssize_t[:, ::1],
                      wheels: cython.Py_ssize_t[::1], least_load: cython.double,
                      least_share: cython.double, runs: cython.double[:, ::1],
                      robot: cython.double[::1], out: cython.double[:, :, ::1]) -> None:
    """
    Average slip, normalized slip, load and traction force of a wheel over each of m crossings.

    ``states`` (runs, n, OUTPUTS) are those of ``simulate``, ``rolling`` (runs, m, k) is r w [m/s]
    of the wheel ``wheels`` (m,) in the ``steps`` (m, k), ``after`` (runs, m) is 1 for crossings
    on the second ground, else 0. Loads are at least ``least_load`` [N], shares of the friction
    that are left at least ``least_share``. ``out`` (runs, m, VALUES) is filled. Raise ValueError
    where shapes disagree.
    """
    count: cython.Py_ssize_t = states.shape[0]
    m: cython.Py_ssize_t = wheels.shape[0]
    run: cython.Py_ssize_t
    if not (states.shape[2] == OUTPUTS and runs.shape[1] == PARAMETERS and runs.shape[0] == count
            and robot.shape[0] == GRAVITY + 1 and rolling.shape[0] == count
            and rolling.shape[1] == m and rolling.shape[2] == steps.shape[1]
            and after.shape[0] == count and after.shape[1] == m and steps.shape[0] == m
            and out.shape[0] == count and out.shape[1] == m and out.shape[2] == VALUES):
        raise ValueError('the shapes of the arrays disagree')
    if not cython.compiled:  # as in ``simulate``
        _average_run(*(np.moveaxis(array, 0, -1) for array in (states, rolling, after)), steps,
                     wheels, least_load, least_share, runs.T, robot, np.moveaxis(out, 0, -1))
        return
    for run in range(count):
        _average_run(states[run], rolling[run], after[run], steps, wheels, least_load,
                     least_share, runs[run], robot, out[run])


@cython.cfunc
def _average_run(states: cython.double[:, ::1], rolling: cython.double[:, ::1],
                 after: cython.double[::1], steps: cython.Py_ssize_t[:, ::1],
                 wheels: cython.Py_ssize_t[::1], least_load: cython.double,
                 least_share: cython.double, p: cython.double[::1], robot: cython.double[::1],
                 out: cython.double[:, ::1]) -> cython.void:
    """Average the crossings of one run."""
    lateral_ratio: cython.double = p[LATERAL_RATIO]
    fall: cython.double = p[FALL]
    com_x: cython.double = p[COM_X]
    com_y: cython.double = p[COM_Y]
    # C_x / mu [N] of the first ground and what the second has more; the ratio of the left side
    old: cython.double = p[OLD_STIFFNESS] / p[OLD_FRICTION]
    change: cython.double = p[STIFFNESS] / p[FRICTION] - old
    left: cython.double = p[SIDE_STIFFNESS] / p[SIDE_FRICTION]
    share: cython.double = 1.0 / steps.shape[1]
    i: cython.Py_ssize_t
    k: cython.Py_ssize_t
    for i in range(wheels.shape[0]):
        wheel: cython.Py_ssize_t = wheels[i]
        base: cython.double = robot[HALF_BASE] if wheel < 2 else -robot[HALF_BASE]
        track: cython.double = robot[HALF_TRACK] if wheel % 2 == 0 else -robot[HALF_TRACK]
        grip: cython.double = (old + after[i] * change) / 3.0
        grip = grip * left if wheel % 2 == 0 else grip / left
        sums: cython.double[5] = [0.0] * 5
        sums[4] = 1.0
        for k in range(steps.shape[1]):
            n: cython.Py_ssize_t = steps[i, k]
            inverse: cython.double = 1.0 / rolling[i, k]
            w: cython.double = states[n, 2]
            slip: cython.double = (rolling[i, k] - states[n, 0] + (track - com_y) * w) * inverse
            lateral: cython.double = lateral_ratio * (states[n, 1] + (base - com_x) * w) * inverse
            load: cython.double = max(states[n, 10 + wheel], least_load)
            t: cython.double = sqrt(slip * slip + lateral * lateral) * grip / load
            kept: cython.double = max(friction_share(1.0 / max(t, 1.0), fall), least_share)
            sums[0] = sums[0] + slip
            sums[1] = sums[1] + t / kept
            sums[2] = sums[2] + load
            sums[3] = sums[3] + states[n, 6 + wheel]
            sums[4] = sums[4] * kept
        for k in range(4):  # columns SLIP to TRACTION
            out[i, k] = sums[k] * share
        out[i, 4] = sums[4]
