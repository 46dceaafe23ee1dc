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

This is plain Python; ``setup.py`` compiles it with Cython where there is a compiler. Several runs
are computed side by side, in groups: of as many as a processor takes (``lanes.pxd``), or, where
nothing is compiled, in one of all runs, as arrays of numpy in place of numbers.
"""

from __future__ import annotations

import numpy as np

from smart_tire.arrays import Array

try:
    import cython
except ImportError:
    from smart_tire.numerics import uncompiled as cython

if cython.compiled:
    from cython.cimports.smart_tire.models.tire.brush_tire import friction_share, secant
    from cython.cimports.smart_tire.numerics.lanes import (
        absolute, Lanes, LANES, lanes, maximum, minimum, square_root, where_larger)
else:
    from numpy import absolute, maximum, minimum, sqrt as square_root
    from smart_tire.models.tire.brush_tire import friction_share, secant
    lanes = float

    def where_larger(a: Array, b: Array, x: Array, y: Array) -> Array:  # noqa: D103
        return np.where(a > b, x, y)

COMPILED: bool = cython.compiled

# parameters of a run, to START_W in the order of ``unknowns.Unknown``; those of two grounds: OLD_
# is the first one, from step NEW on it is the second
(STIFFNESS, FRICTION, RESISTANCE, OLD_STIFFNESS, OLD_FRICTION, OLD_RESISTANCE,
 LATERAL_SHARE, LATERAL_RATIO, COM_X, COM_Y, RADIUS, SLOPE_X, SLOPE_Y, SIDE_STIFFNESS,
 SIDE_FRICTION, SIDE_RESISTANCE, DELAY, FALL, MOVED_LOAD, BEND_X, BEND_Y, START_U, START_V,
 START_W, RELAXATION, NEW, _, _, _, LIFT, _, _, _, _, _, PARAMETERS) = range(36)
# NEW: of the left and of the right side the steps from which, and until which, its ground is the
# second one; then of each of two lifts: index of the wheel, steps of its begin and end
# constants of the robot: step [s], mass [kg], yaw inertia [kg m2], half wheelbase and track [m],
# height of the center of mass [m], least speeds [m/s] of slip and of resistance, gravity [m/s2]
TIME_STEP, MASS, INERTIA, HALF_BASE, HALF_TRACK, HEIGHT, SLIP_FLOOR, DRAG_FLOOR, GRAVITY = range(9)
# output of a step: velocity, acceleration of the center of mass by forces, angular acceleration,
# tread forces along x of the wheels, their loads, and the square of the yaw rate
(U, V, W, A_X, A_Y, W_DOT, FORCE, _, _, _, LOADS, _, _, _, SQUARE, OUTPUTS) = range(16)
# means over a crossing; LOSS is the product of the shares of the friction that are left
SLIP, NORMALIZED, LOAD, TRACTION, LOSS, VALUES = range(6)


def grouped(runs: Array) -> Array:
    """Return ``runs`` (count, k) as groups (groups, k, lanes); the last run fills the last one."""
    width = LANES if cython.compiled else len(runs)
    filled = np.concatenate([runs, runs[len(runs) - 1:].repeat(-len(runs) % width, axis=0)])
    return np.ascontiguousarray(filled.reshape(-1, width, runs.shape[1]).transpose(0, 2, 1))


def ungrouped(groups: Array, count: int) -> Array:
    """Return values (count, ...) of runs from those of their groups (groups, ..., lanes)."""
    _, *shape, width = groups.shape
    return groups.reshape(len(groups), -1, width).transpose(0, 2, 1).reshape(-1, *shape)[:count]


def simulate(rolling: cython.double[:, ::1], delayed: cython.double[:, ::1],
             heading: cython.double[:, ::1], runs: cython.double[:, :, ::1],
             robot: cython.double[::1], out: cython.double[:, :, :, ::1],
             means: cython.double[:, :, :, ::1]) -> None:
    """
    Simulate all runs over n steps.

    ``rolling`` (n, 4): r w [m/s] of the wheels at the end of each step, by the nominal radius.
    ``delayed`` (n, 2): change [m/s] of r w of the left and of the right side by 1 s of delay.
    ``heading`` (n, 2): cosine and sine of the heading in the frame of the slopes.
    ``runs``, ``grouped``: C_x [N], mu, f, their ratios of the left side to the mean, and so on.
    ``robot``: constants. ``out`` (groups, n, OUTPUTS, lanes) is filled, and ``means`` (groups,
    blocks, OUTPUTS, lanes) with its means over blocks, by trapezoids. Raise ValueError where
    shapes disagree.
    """
    n: cython.Py_ssize_t = rolling.shape[0]
    blocks: cython.Py_ssize_t = means.shape[1]
    width: cython.Py_ssize_t = LANES if cython.compiled else runs.shape[2]
    group: cython.Py_ssize_t
    lane: cython.Py_ssize_t
    if not (rolling.shape[1] == 4 and heading.shape[0] == n and heading.shape[1] == 2
            and delayed.shape[0] == n and delayed.shape[1] == 2 and runs.shape[1] == PARAMETERS
            and robot.shape[0] == GRAVITY + 1 and runs.shape[2] == width
            and out.shape[0] == runs.shape[0] and out.shape[1] == n and out.shape[2] == OUTPUTS
            and out.shape[3] == width and means.shape[0] == runs.shape[0]
            and n % blocks == 0 and means.shape[2] == OUTPUTS and means.shape[3] == width):
        raise ValueError('the shapes of the arrays disagree')
    new: cython.Py_ssize_t = NEW  # names of the module are slow in loops
    lift: cython.Py_ssize_t = LIFT
    for group in range(runs.shape[0]):
        events: cython.bint = False  # in any of the runs
        for lane in range(width):
            events = (
                events or max(runs[group, new, lane], runs[group, new + 2, lane]) > 0.0
                or min(runs[group, new + 1, lane], runs[group, new + 3, lane]) < n
                or max(runs[group, lift, lane], runs[group, lift + 3, lane]) >= 0.0)
        if cython.compiled:
            p = cython.cast(cython.pointer(Lanes), cython.address(runs[group, 0, 0]))
            rows = cython.cast(cython.pointer(Lanes), cython.address(out[group, 0, 0, 0]))
            sums = cython.cast(cython.pointer(Lanes), cython.address(means[group, 0, 0, 0]))
        else:
            p, rows, sums = (array[group].reshape(-1, width) for array in (runs, out, means))
        _simulate_runs(rolling, delayed, heading, p, robot, events, rows)
        _block_means(rows, n // blocks, blocks, sums)


@cython.cfunc
def _block_means(rows: cython.pointer[Lanes], size: cython.Py_ssize_t,
                 blocks: cython.Py_ssize_t, means: cython.pointer[Lanes]) -> cython.void:
    """Average ``rows`` over blocks of ``size`` steps."""
    k: cython.Py_ssize_t
    n: cython.Py_ssize_t
    block: cython.Py_ssize_t
    share: cython.double = 1.0 / size
    for block in range(blocks):
        for k in range(15):  # OUTPUTS
            last: cython.Py_ssize_t = 15 * (block + 1) * size - 15 + k
            total: Lanes = lanes(0.0)
            for n in range(size):
                total = total + rows[15 * (block * size + n) + k]
            if block:
                total = total + 0.5 * (rows[last - 15 * size] - rows[last])
            means[15 * block + k] = share * total


@cython.cfunc
@cython.exceptval(check=False)
def _load(level: Lanes, by_x: Lanes, by_y: Lanes, a_x: Lanes, a_y: Lanes) -> Lanes:
    """Return the load [N] from that at rest, of all wheels; below 0: they would pull."""
    return level - by_x * a_x - by_y * a_y


@cython.cfunc
@cython.exceptval(check=False)
def _inside(n: cython.double, begin: Lanes, end: Lanes) -> Lanes:
    """Return 1 if step ``n`` is one from ``begin`` until ``end``, else 0."""
    zero: Lanes = lanes(0.0)
    unit: Lanes = lanes(1.0)
    return (minimum(maximum(n + 1.0 - begin, zero), unit)
            - minimum(maximum(n + 1.0 - end, zero), unit))


@cython.cfunc
def _simulate_runs(rolling: cython.double[:, ::1], delayed: cython.double[:, ::1],
                   heading: cython.double[:, ::1], p: cython.pointer[Lanes],
                   robot: cython.double[::1], events: cython.bint,
                   out: cython.pointer[Lanes]) -> cython.void:
    """Simulate a group of runs; what its steps have in common is computed before them."""
    zero: Lanes = lanes(0.0)
    unit: Lanes = lanes(1.0)
    frequency: cython.double = 1.0 / robot[TIME_STEP]
    mass: cython.double = robot[MASS]
    inertia: cython.double = robot[INERTIA]
    min_rolling: Lanes = lanes(robot[SLIP_FLOOR])
    min_speed: Lanes = lanes(robot[DRAG_FLOOR])
    least_slip: Lanes = lanes(1e-9)
    gravity: cython.double = robot[GRAVITY]
    steps: cython.double = rolling.shape[0]
    share: Lanes = p[LATERAL_SHARE]
    lengthwise: Lanes = 1.0 - share
    lateral_ratio: Lanes = p[LATERAL_RATIO]
    radius: Lanes = p[RADIUS]
    fall: Lanes = p[FALL]
    relaxation: Lanes = p[RELAXATION] * frequency  # m/s
    delay: Lanes = p[DELAY]
    slopes_x: Lanes = p[SLOPE_X]
    slopes_y: Lanes = p[SLOPE_Y]
    bend_x: Lanes = p[BEND_X]
    bend_y: Lanes = p[BEND_Y]
    # of the wheels: position [m], load at rest [N] and by acceleration [kg], share that it gets of
    # the load that is lost in each lift, ground before its change and (4-7) the change
    x: Lanes[4] = [zero] * 4
    y: Lanes[4] = [zero] * 4
    level: Lanes[4] = [zero] * 4
    by_x: Lanes[4] = [zero] * 4
    by_y: Lanes[4] = [zero] * 4
    gets: Lanes[8] = [zero] * 8
    # of the lifted wheels: load at rest [N] and by acceleration [kg]
    own_level: Lanes[2] = [zero] * 2
    own_x: Lanes[2] = [zero] * 2
    own_y: Lanes[2] = [zero] * 2
    stiffness: Lanes[8] = [zero] * 8
    friction: Lanes[8] = [zero] * 8
    resistance: Lanes[8] = [zero] * 8
    # in a step: r w [m/s], slip, |F| / |s| [N], change of the slip by the new velocity [s/m],
    # share of the slip that is stored, stiffness [N], normalized slip up to 1, rolling resistance
    # over the velocity [N s/m], load [N], friction and rolling resistance over the load
    roll: Lanes[4] = [zero] * 4
    slip_x: Lanes[4] = [zero] * 4
    slip_y: Lanes[4] = [zero] * 4
    slope: Lanes[4] = [zero] * 4
    gain: Lanes[4] = [zero] * 4
    kept: Lanes[4] = [zero] * 4
    stiff: Lanes[4] = [zero] * 4
    t: Lanes[4] = [zero] * 4
    drag_x: Lanes[4] = [zero] * 4
    drag_y: Lanes[4] = [zero] * 4
    load: Lanes[4] = [zero] * 4
    rough: Lanes[4] = [zero] * 4
    resists: Lanes[4] = [zero] * 4
    i: cython.int
    k: cython.int
    for i in range(4):
        left: cython.bint = i % 2 == 0
        base: Lanes = lanes(robot[HALF_BASE] if i < 2 else -robot[HALF_BASE])
        track: Lanes = lanes(robot[HALF_TRACK] if left else -robot[HALF_TRACK])
        x[i] = base - p[COM_X]
        y[i] = track - p[COM_Y]
        level[i] = 0.25 * mass * robot[GRAVITY] * (1.0 + p[COM_X] / base + p[COM_Y] / track)
        by_x[i] = lanes(0.25 * mass * robot[HEIGHT]) / base
        by_y[i] = lanes(0.25 * mass * robot[HEIGHT]) / track
        for k in range(2):
            diagonal: Lanes = maximum(1.0 - absolute(p[LIFT + 3 * k] - (3.0 - i)), zero)
            lost: Lanes = maximum(1.0 - absolute(p[LIFT + 3 * k] - 1.0 * i), zero)
            gets[4 * k + i] = p[MOVED_LOAD] * (2.0 * diagonal + lost - 1.0) - lost
            own_level[k] = own_level[k] + lost * level[i]
            own_x[k] = own_x[k] + lost * by_x[i]
            own_y[k] = own_y[k] + lost * by_y[i]
        side: Lanes = p[SIDE_STIFFNESS] if left else unit / p[SIDE_STIFFNESS]
        stiffness[i] = side * p[OLD_STIFFNESS]
        stiffness[4 + i] = side * (p[STIFFNESS] - p[OLD_STIFFNESS])
        side = p[SIDE_FRICTION] if left else unit / p[SIDE_FRICTION]
        friction[i] = side * p[OLD_FRICTION]
        friction[4 + i] = side * (p[FRICTION] - p[OLD_FRICTION])
        side = p[SIDE_RESISTANCE] if left else unit / p[SIDE_RESISTANCE]
        resistance[i] = side * p[OLD_RESISTANCE]
        resistance[4 + i] = side * (p[RESISTANCE] - p[OLD_RESISTANCE])

    new: cython.Py_ssize_t = NEW
    lift: cython.Py_ssize_t = LIFT
    first: Lanes = zero
    second: Lanes = zero
    one: Lanes = zero  # N, lost in both lifts
    two: Lanes = zero
    u: Lanes = p[START_U]
    v: Lanes = p[START_V]
    w: Lanes = p[START_W]
    last_u: Lanes = u
    last_v: Lanes = v
    last_w: Lanes = w
    a_x: Lanes = zero
    a_y: Lanes = zero
    n: cython.Py_ssize_t
    for n in range(rolling.shape[0]):
        # y' = (rate y - old_y): BDF2, in the first step Euler
        rate: cython.double = (1.5 if n else 1.0) * frequency
        lead: cython.double = 2.0 if n else 1.0
        trail: cython.double = 0.5 if n else 0.0
        old_u: Lanes = (lead * u - trail * last_u) * frequency
        old_v: Lanes = (lead * v - trail * last_v) * frequency
        old_w: Lanes = (lead * w - trail * last_w) * frequency
        new_u: Lanes = 2.0 * u - last_u
        new_v: Lanes = 2.0 * v - last_v
        new_w: Lanes = 2.0 * w - last_w
        part: cython.double = (n + 0.5) / steps - 0.5  # of the window, from its middle
        gravity_x: Lanes = gravity * (slopes_x + part * bend_x)
        gravity_y: Lanes = gravity * (slopes_y + part * bend_y)
        slope_x: Lanes = heading[n, 0] * gravity_x + heading[n, 1] * gravity_y
        slope_y: Lanes = heading[n, 0] * gravity_y - heading[n, 1] * gravity_x
        # symmetric equations of the new velocity: [uu 0 uw; 0 vv vw; uw vw ww] y = (bu, bv, bw)
        uu: Lanes = lanes(mass * rate)
        vv: Lanes = lanes(mass * rate)
        ww: Lanes = lanes(inertia * rate)
        uw: Lanes = zero
        vw: Lanes = zero
        bu: Lanes = mass * (old_u + new_w * new_v - slope_x)
        bv: Lanes = mass * (old_v - new_w * new_u - slope_y)
        bw: Lanes = inertia * old_w
        # the first step begins with the slip of its end
        lag: Lanes = relaxation if n else zero
        if events or not n:
            first = _inside(n, p[lift + 1], p[lift + 2])
            second = _inside(n, p[lift + 4], p[lift + 5])
            one = first * _load(own_level[0], own_x[0], own_y[0], a_x, a_y)
            two = second * _load(own_level[1], own_x[1], own_y[1], a_x, a_y)
            for i in range(4):
                begin: cython.Py_ssize_t = new + 2 * (i % 2)
                after: Lanes = _inside(n, p[begin], p[begin + 1])
                stiff[i] = stiffness[i] + after * stiffness[4 + i]
                rough[i] = friction[i] + after * friction[4 + i]
                resists[i] = resistance[i] + after * resistance[4 + i]
                load[i] = maximum(_load(level[i], by_x[i], by_y[i], a_x, a_y)
                                  + one * gets[i] + two * gets[4 + i], zero)
        for i in range(4):
            roll[i] = radius * rolling[n, i] + delay * delayed[n, i % 2]
            v_x: Lanes = new_u - y[i] * new_w
            v_y: Lanes = new_v + x[i] * new_w
            along: Lanes = maximum(absolute(v_x), min_speed)
            speed: Lanes = maximum(square_root(v_x * v_x + v_y * v_y), min_speed)
            drag: Lanes = load[i] * resists[i] / (along * speed)  # one division for both
            drag_x[i] = lengthwise * drag * speed
            drag_y[i] = share * drag * along
            gain[i] = unit / (maximum(absolute(roll[i]), min_rolling) + lag)
            slip_x[i] = slip_x[i] * lag * gain[i]
            slip_y[i] = slip_y[i] * lag * gain[i]
            s_x: Lanes = slip_x[i] + gain[i] * (roll[i] - v_x)
            s_y: Lanes = slip_y[i] + gain[i] * lateral_ratio * v_y
            full: Lanes = 3.0 * (load[i] * rough[i])
            # N, without sliding; t = 1 at ``full``
            elastic: Lanes = stiff[i] * maximum(square_root(s_x * s_x + s_y * s_y), least_slip)
            scale: Lanes = unit / maximum(elastic, full)
            kept[i] = full * scale  # a tire that slides deflects no further
            t[i] = elastic * scale
        for i in range(4):
            slope[i] = stiff[i] * secant(t[i], kept[i], fall)
        for i in range(4):
            grip: Lanes = gain[i] * slope[i]
            along = grip + drag_y[i] + drag_x[i]
            across: Lanes = lateral_ratio * grip + drag_y[i]
            force: Lanes = grip * roll[i] + slope[i] * slip_x[i]
            uu += along
            uw -= along * y[i]
            vv += across
            vw += across * x[i]
            ww += across * x[i] * x[i] + along * y[i] * y[i]
            bu += force
            bv -= slope[i] * slip_y[i]
            bw -= y[i] * force + x[i] * slope[i] * slip_y[i]
        uu = unit / uu
        vv = unit / vv
        along = uw * uu
        across = vw * vv
        new_w = (bw - along * bu - across * bv) / (ww - along * uw - across * vw)
        new_u = bu * uu - along * new_w
        new_v = bv * vv - across * new_w
        a_x = rate * new_u - old_u - new_w * new_v + slope_x
        a_y = rate * new_v - old_v + new_w * new_u + slope_y
        one = first * _load(own_level[0], own_x[0], own_y[0], a_x, a_y)
        two = second * _load(own_level[1], own_x[1], own_y[1], a_x, a_y)
        # columns by their numbers
        row: cython.Py_ssize_t = 15 * n
        out[row], out[row + 1], out[row + 2] = new_u, new_v, new_w
        out[row + 3], out[row + 4] = a_x, a_y
        out[row + 5] = rate * new_w - old_w
        out[row + 14] = new_w * new_w
        for i in range(4):
            s_x = slip_x[i] + gain[i] * (roll[i] - new_u + y[i] * new_w)
            s_y = slip_y[i] + gain[i] * lateral_ratio * (new_v + x[i] * new_w)
            out[row + 6 + i] = slope[i] * s_x
            load[i] = maximum(_load(level[i], by_x[i], by_y[i], a_x, a_y)
                              + one * gets[i] + two * gets[4 + i], zero)
            out[row + 10 + i] = load[i]
            slip_x[i] = kept[i] * s_x
            slip_y[i] = kept[i] * s_y
        last_u, last_v, last_w = u, v, w
        u, v, w = new_u, new_v, new_w


def average_crossings(states: cython.double[:, :, :, ::1], rolling: cython.double[:, ::1],
                      delayed: cython.double[:, ::1], after: cython.double[:, :, ::1],
                      steps: cython.Py_ssize_t[:, ::1], wheels: cython.Py_ssize_t[::1],
                      least_load: cython.double, least_share: cython.double,
                      runs: cython.double[:, :, ::1], robot: cython.double[::1],
                      out: cython.double[:, :, :, ::1]) -> None:
    """
    Average slip, normalized slip, load and traction force of a wheel over each of m crossings.

    ``states`` (groups, n, OUTPUTS, lanes) are those of ``simulate``, as are ``rolling``,
    ``delayed``, ``runs`` and ``robot``. ``after`` (groups, m, lanes) is 1 for crossings on the
    second ground, else 0; they are those of the wheels ``wheels`` (m,) in the ``steps`` (m, k).
    Loads are at least ``least_load`` [N], shares of the friction that are left at least
    ``least_share``. ``out`` (groups, m, VALUES, lanes) is filled. Raise ValueError where shapes
    disagree.
    """
    m: cython.Py_ssize_t = wheels.shape[0]
    width: cython.Py_ssize_t = LANES if cython.compiled else runs.shape[2]
    group: cython.Py_ssize_t
    if not (states.shape[2] == OUTPUTS and runs.shape[1] == PARAMETERS
            and runs.shape[0] == states.shape[0] and robot.shape[0] == GRAVITY + 1
            and rolling.shape[0] == states.shape[1] and rolling.shape[1] == 4
            and delayed.shape[0] == states.shape[1] and delayed.shape[1] == 2
            and after.shape[0] == states.shape[0] and after.shape[1] == m
            and after.shape[2] == width and steps.shape[0] == m
            and out.shape[0] == states.shape[0] and out.shape[1] == m
            and out.shape[2] == VALUES and runs.shape[2] == width and out.shape[3] == width
            and states.shape[3] == width):
        raise ValueError('the shapes of the arrays disagree')
    for group in range(runs.shape[0]):
        if cython.compiled:
            p = cython.cast(cython.pointer(Lanes), cython.address(runs[group, 0, 0]))
            rows = cython.cast(cython.pointer(Lanes), cython.address(states[group, 0, 0, 0]))
            found = cython.cast(cython.pointer(Lanes), cython.address(out[group, 0, 0, 0]))
            on_new = cython.cast(cython.pointer(Lanes), cython.address(after[group, 0, 0]))
        else:
            p, rows, found, on_new = (
                array[group].reshape(-1, width) for array in (runs, states, out, after))
        _average_runs(rows, rolling, delayed, on_new, steps, wheels, least_load, least_share, p,
                      robot, found)


@cython.cfunc
def _average_runs(states: cython.pointer[Lanes], rolling: cython.double[:, ::1],
                  delayed: cython.double[:, ::1], after: cython.pointer[Lanes],
                  steps: cython.Py_ssize_t[:, ::1], wheels: cython.Py_ssize_t[::1],
                  least_load: cython.double, least_share: cython.double,
                  p: cython.pointer[Lanes], robot: cython.double[::1],
                  out: cython.pointer[Lanes]) -> cython.void:
    """Average the crossings of a group of runs."""
    zero: Lanes = lanes(0.0)
    unit: Lanes = lanes(1.0)
    floor: Lanes = lanes(robot[SLIP_FLOOR])
    min_load: Lanes = lanes(least_load)
    min_share: Lanes = lanes(least_share)
    radius: Lanes = p[RADIUS]
    delay: Lanes = p[DELAY]
    lateral_ratio: Lanes = p[LATERAL_RATIO]
    fall: Lanes = p[FALL]
    com_x: Lanes = p[COM_X]
    com_y: Lanes = p[COM_Y]
    # C_x / mu [N] of the first ground and what the second has more; the ratio of the left side
    old: Lanes = p[OLD_STIFFNESS] / p[OLD_FRICTION]
    change: Lanes = p[STIFFNESS] / p[FRICTION] - old
    left: Lanes = p[SIDE_STIFFNESS] / p[SIDE_FRICTION]
    count: cython.Py_ssize_t = steps.shape[1]
    share: cython.double = 1.0 / count
    i: cython.Py_ssize_t
    k: cython.Py_ssize_t
    for i in range(wheels.shape[0]):
        wheel: cython.Py_ssize_t = wheels[i]
        side: cython.Py_ssize_t = wheel % 2
        base: cython.double = robot[HALF_BASE] if wheel < 2 else -robot[HALF_BASE]
        track: cython.double = robot[HALF_TRACK] if side == 0 else -robot[HALF_TRACK]
        grip: Lanes = (old + after[i] * change) / lanes(3.0)
        grip = grip * left if side == 0 else grip / left
        sums: Lanes[5] = [zero] * 5
        sums[4] = unit
        for k in range(count):
            n: cython.Py_ssize_t = steps[i, k]
            row: cython.Py_ssize_t = 15 * n
            roll: Lanes = radius * rolling[n, wheel] + delay * delayed[n, side]
            roll = where_larger(floor, absolute(roll), floor, roll)
            inverse: Lanes = unit / roll
            w: Lanes = states[row + 2]
            slip: Lanes = (roll - states[row] + (track - com_y) * w) * inverse
            lateral: Lanes = lateral_ratio * (states[row + 1] + (base - com_x) * w) * inverse
            load: Lanes = maximum(states[row + 10 + wheel], min_load)
            t: Lanes = square_root(slip * slip + lateral * lateral) * grip / load
            kept: Lanes = maximum(friction_share(unit / maximum(t, unit), fall), min_share)
            sums[0] = sums[0] + slip
            sums[1] = sums[1] + t / kept
            sums[2] = sums[2] + load
            sums[3] = sums[3] + states[row + 6 + wheel]
            sums[4] = sums[4] * kept
        for k in range(4):  # columns SLIP to TRACTION
            out[5 * i + k] = sums[k] * share
        out[5 * i + 4] = sums[4]
