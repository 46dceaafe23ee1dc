# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Motion on brush tires: compiled and with numpy; physics that holds in both."""

from __future__ import annotations

import numpy as np
import pytest
from smart_tire.estimation.ground import body_model as model
from smart_tire.estimation.ground.wheel_motion import block_means
from support.compiled import load_source

STEP, MASS, INERTIA, GRAVITY = 0.016, 15.0, 0.6, 9.81  # s, kg, kg m2, m/s2
HALF_BASE, HALF_TRACK, HEIGHT = 0.2, 0.18, 0.1         # m
MIN_ROLLING, MIN_SPEED = 0.02, 0.01                    # m/s
ROBOT = np.array([STEP, MASS, INERTIA, HALF_BASE, HALF_TRACK, HEIGHT, MIN_ROLLING, MIN_SPEED,
                  GRAVITY])
X = HALF_BASE * np.array([1.0, 1.0, -1.0, -1.0])
Y = HALF_TRACK * np.array([1.0, -1.0, 1.0, -1.0])
FORCES = slice(model.FORCE, model.LOADS)
LOADS = slice(model.LOADS, model.SQUARE)
VELOCITY = slice(model.START_U, model.START_W + 1)


def ground(count: int = 1, **values: float) -> np.ndarray:
    """Return runs on one level ground, both sides equal, from standstill."""
    runs = np.zeros((count, model.PARAMETERS))
    runs[:, [model.NEW + 1, model.NEW + 3]] = np.inf  # on the second ground from the start
    for name, value in {
            'STIFFNESS': 1200.0, 'FRICTION': 0.6, 'RADIUS': 1.0, 'LATERAL_RATIO': 1.0,
            'SIDE_STIFFNESS': 1.0, 'SIDE_FRICTION': 1.0, 'SIDE_RESISTANCE': 1.0,
            **values}.items():
        runs[:, getattr(model, name)] = value
    return runs


def simulate(rolling: np.ndarray, runs: np.ndarray, by=model, robot: np.ndarray = ROBOT,
             delayed: np.ndarray | None = None, heading: np.ndarray | None = None,
             blocks: int | None = None) -> np.ndarray:
    """Return the output of all runs, or its means over ``blocks``, as of ``motion``."""
    groups = by.grouped(runs)
    out = motion(rolling, groups, by, robot, delayed, heading, blocks)
    return by.ungrouped(out[blocks is not None], len(runs))


def motion(rolling: np.ndarray, groups: np.ndarray, by, robot: np.ndarray = ROBOT,
           delayed: np.ndarray | None = None, heading: np.ndarray | None = None,
           blocks: int | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return the output of all groups and its means, without delays and turns if not given."""
    n, width = len(rolling), groups.shape[2]
    out, means = (np.full((len(groups), count, model.OUTPUTS, width), np.nan)
                  for count in (n, blocks or 1))
    by.simulate(rolling, np.zeros((n, 2)) if delayed is None else delayed,
                np.tile([1.0, 0.0], (n, 1)) if heading is None else heading, groups, robot,
                out, means)
    return out, means


def random_case(kind: str) -> dict[str, np.ndarray]:
    """Return random runs with changes of ground, slopes and different sides, by ``kind``."""
    random = np.random.default_rng(7)
    count, n = 9, 120  # not all groups are full
    speeds = {'lifted': 1.5, 'standstill': 0.0, 'reverse': -0.4}.get(kind, 0.5)
    rolling = speeds * (1.0 + np.sin(np.linspace(0.0, 20.0, n)))[:, np.newaxis] \
        + (0.0 if kind == 'standstill' else 0.1) * random.standard_normal((n, 4))
    runs = ground(count)
    runs[:, model.NEW:model.LIFT] = n // 2, np.inf, n // 3, n - 10
    for name, low, high in (
            ('LATERAL_SHARE', 0.0, 1.0), ('LATERAL_RATIO', 0.6, 1.0), ('COM_X', -0.03, 0.03),
            ('COM_Y', -0.03, 0.03), ('RADIUS', 0.98, 1.02), ('SLOPE_X', -0.03, 0.03),
            ('SLOPE_Y', -0.03, 0.03), ('SIDE_STIFFNESS', 0.8, 1.2), ('SIDE_FRICTION', 0.8, 1.2),
            ('SIDE_RESISTANCE', 0.8, 1.2), ('START_U', -0.5, 0.5), ('START_V', -0.2, 0.2),
            ('START_W', -1.0, 1.0), ('OLD_STIFFNESS', 300.0, 3000.0), ('STIFFNESS', 300.0, 3000.0),
            ('OLD_FRICTION', 0.3, 1.0), ('FRICTION', 0.3, 1.0), ('OLD_RESISTANCE', 0.0, 0.15),
            ('RESISTANCE', 0.0, 0.15), ('FALL', 0.0, 0.5), ('BEND_X', -0.05, 0.05),
            ('BEND_Y', -0.05, 0.05), ('DELAY', -0.01, 0.01), ('RELAXATION', 0.0, 0.05)):
        runs[:, getattr(model, name)] = random.uniform(low, high, count)
    for row in (model.LIFT, model.LIFT + 3):  # none in the first runs; steps of begin and end
        runs[:, row:row + 3] = np.column_stack([
            random.integers(-1, 4, count), random.integers(0, n // 2, count),
            random.integers(n // 2, n, count)])
    runs[:, model.MOVED_LOAD] = random.uniform(-1.0, 0.3, count)
    if kind == 'sliding':
        runs[:, [model.OLD_FRICTION, model.FRICTION]] = 0.05
    robot = ROBOT.copy()
    if kind == 'lifted':
        robot[model.HEIGHT] = 0.5
    angle = np.linspace(0.0, 4.0, n)
    return {'rolling': rolling, 'runs': runs, 'robot': robot,
            'delayed': random.standard_normal((n, 2)),
            'heading': np.column_stack([np.cos(angle), np.sin(angle)])}


KINDS = ('driving', 'lifted', 'standstill', 'reverse', 'sliding')


@pytest.mark.skipif(not model.COMPILED, reason='not compiled')
@pytest.mark.parametrize('kind', KINDS)
def test_the_extension_computes_what_its_source_does(kind):
    case = random_case(kind)
    by = load_source(model)
    for blocks in (None, 15):
        np.testing.assert_array_equal(
            simulate(**case, blocks=blocks), simulate(**case, by=by, blocks=blocks))


def test_means_over_blocks_are_those_of_trapezoids():
    case = random_case('driving')
    steps, means = simulate(**case), simulate(**case, blocks=15)
    np.testing.assert_allclose(means, block_means(steps), rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(steps[..., model.SQUARE], steps[..., model.W] ** 2)


def crossings(case: dict[str, np.ndarray], by=model, **arrays: np.ndarray) -> np.ndarray:
    """Return the means over crossings of all wheels, before and after the change of ground."""
    groups = by.grouped(case['runs'])
    steps, wheels = np.arange(10, 114, 13)[:, np.newaxis] + np.arange(6), np.arange(8) % 4
    begins, ends = (case['runs'][:, model.NEW + 2 * (wheels % 2) + one] for one in (0, 1))
    after = by.grouped(((begins <= steps[:, 0]) & (steps[:, 0] < ends)).astype(float))
    given = {'steps': steps, 'wheels': wheels, 'robot': case['robot'], **arrays}
    out = np.full((len(groups), 8, model.VALUES, groups.shape[2]), np.nan)
    states, _ = motion(case['rolling'], groups, by, *(
        case[name] for name in ('robot', 'delayed', 'heading')))
    by.average_crossings(states, case['rolling'], case['delayed'], after, given['steps'],
                         given['wheels'], 0.1, 0.2, groups, given['robot'], out)
    return by.ungrouped(out, len(case['runs']))


@pytest.mark.skipif(not model.COMPILED, reason='not compiled')
@pytest.mark.parametrize('kind', KINDS)
def test_the_extension_averages_crossings_as_its_source_does(kind):
    case = random_case(kind)
    np.testing.assert_array_equal(crossings(case), crossings(case, by=load_source(model)))


def test_the_means_of_a_crossing_are_those_of_its_wheel():
    case = random_case('driving')
    case['runs'][:, [model.OLD_STIFFNESS, model.OLD_FRICTION]] = case['runs'][
        :, [model.STIFFNESS, model.FRICTION]]
    case['runs'][:, model.NEW:model.LIFT] = 0.0, np.inf, 0.0, np.inf
    case['runs'][:, [model.LIFT, model.LIFT + 3]] = -1.0
    states, runs, found = simulate(**case), case['runs'], crossings(case)
    steps, wheel = 10 + 13 * 2 + np.arange(6), 2  # rear left
    np.testing.assert_allclose(
        found[:, wheel, model.TRACTION], states[:, steps, model.FORCE + wheel].mean(axis=1))
    # B(19), with the loads of the springs
    x, y = (axis - runs[:, [column]] for axis, column in (
        (X[wheel], model.COM_X), (Y[wheel], model.COM_Y)))
    load = 0.25 * MASS * (
        GRAVITY * (1.0 + runs[:, [model.COM_X]] / X[wheel] + runs[:, [model.COM_Y]] / Y[wheel])
        - HEIGHT * (states[:, steps, model.A_X] / X[wheel]
                    + states[:, steps, model.A_Y] / Y[wheel]))
    np.testing.assert_allclose(found[:, wheel, model.LOAD], load.mean(axis=1))
    rolling = (runs[:, [model.RADIUS]] * case['rolling'][steps, wheel]
               + runs[:, [model.DELAY]] * case['delayed'][steps, wheel % 2])
    rolling = np.where(abs(rolling) < MIN_ROLLING, MIN_ROLLING, rolling)
    s_x = 1.0 - (states[:, steps, model.U] - y * states[:, steps, model.W]) / rolling
    s_y = runs[:, [model.LATERAL_RATIO]] * (
        states[:, steps, model.V] + x * states[:, steps, model.W]) / rolling
    np.testing.assert_allclose(found[:, wheel, model.SLIP], s_x.mean(axis=1))
    critical = 3.0 * load * (
        runs[:, [model.FRICTION]] * runs[:, [model.SIDE_FRICTION]]
        / (runs[:, [model.STIFFNESS]] * runs[:, [model.SIDE_STIFFNESS]]))
    t = np.hypot(s_x, s_y) / critical
    kept = np.maximum(1.0 - runs[:, [model.FALL]] * (1.0 - 1.0 / np.maximum(t, 1.0)), 0.2)
    np.testing.assert_allclose(
        found[:, wheel, model.NORMALIZED], (t / kept).mean(axis=1))
    np.testing.assert_allclose(found[:, wheel, model.LOSS], kept.prod(axis=1))


def test_crossings_of_other_shapes_are_refused():
    case = random_case('driving')
    for name in ('steps', 'wheels', 'robot'):
        given = {'steps': np.zeros((8, 6), dtype=int), 'wheels': np.arange(8) % 4,
                 'robot': ROBOT}[name]
        with pytest.raises(ValueError, match='shapes'):
            crossings(case, **{name: given[:-1]})


def test_arrays_of_other_shapes_are_refused():
    for name in ('rolling', 'delayed', 'heading', 'runs', 'robot'):
        case = random_case('driving')
        with pytest.raises(ValueError, match='shapes'):
            simulate(**case | {name: np.ascontiguousarray(case[name][..., :-1])})


def test_standstill_lasts():
    out = simulate(np.zeros((50, 4)), ground(RESISTANCE=0.1, COM_X=0.02))
    assert not out[..., :model.LOADS].any()
    np.testing.assert_allclose(out[..., LOADS].sum(axis=-1), MASS * GRAVITY)


@pytest.mark.parametrize('kind', KINDS)
def test_the_mirror_image_of_a_drive_is_its_mirror_image(kind):
    case = random_case(kind)
    mirrored = {name: array.copy() for name, array in case.items()}
    mirrored['rolling'] = np.ascontiguousarray(case['rolling'][:, [1, 0, 3, 2]])
    mirrored['delayed'] = np.ascontiguousarray(case['delayed'][..., ::-1])
    mirrored['heading'][:, 1] *= -1.0
    runs = mirrored['runs']
    runs[:, [model.COM_Y, model.SLOPE_Y, model.BEND_Y, model.START_V, model.START_W]] *= -1.0
    sides = [model.SIDE_STIFFNESS, model.SIDE_FRICTION, model.SIDE_RESISTANCE]
    runs[:, sides] = 1.0 / runs[:, sides]
    runs[:, model.NEW:model.LIFT] = runs[:, [model.NEW + one for one in (2, 3, 0, 1)]]
    for row in (model.LIFT, model.LIFT + 3):
        runs[:, row] = np.array([1.0, 0.0, 3.0, 2.0, -1.0])[runs[:, row].astype(int)]
    expected = simulate(**case)
    expected[..., [model.V, model.W, model.A_Y, model.W_DOT]] *= -1.0
    for part in (FORCES, LOADS):
        expected[..., part] = expected[..., part][..., [1, 0, 3, 2]]
    np.testing.assert_allclose(simulate(**mirrored), expected, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize('side', [0, 1])
def test_the_ground_of_a_side_changes_at_its_steps(side):
    case = random_case('driving')
    begin, end = 40, 70
    case['runs'][:, model.LIFT], case['runs'][:, model.LIFT + 3] = -1.0, -1.0
    case['runs'][:, model.NEW:model.LIFT] = np.inf
    old = simulate(**case)
    case['runs'][:, model.NEW + 2 * side:model.NEW + 2 * side + 2] = begin, end
    changed = simulate(**case)
    np.testing.assert_array_equal(changed[:, :begin], old[:, :begin])
    assert (changed[:, begin] != old[:, begin]).any(axis=1).all()


@pytest.mark.parametrize('side', [0, 1])
def test_a_side_on_ground_that_slides_has_the_force_of_its_friction(side):
    runs = ground(OLD_STIFFNESS=1200.0, OLD_FRICTION=0.6, FRICTION=0.05, START_U=0.5)
    runs[0, model.NEW:model.LIFT] = np.inf
    runs[0, model.NEW + 2 * side:model.NEW + 2 * side + 2] = 10, 30
    out = simulate(np.tile(0.5 + 0.02 * np.arange(40.0)[:, np.newaxis], (1, 4)), runs)[0]
    share = out[:, FORCES] / out[:, LOADS]
    assert share[15:30, side::2] == pytest.approx(0.05, rel=0.1)
    assert share[15:30, 1 - side::2].min() > 0.08
    assert share[35:].min() > 0.08  # back on the first ground


@pytest.mark.parametrize('share', [0.0, 0.4, 1.0])
def test_forces_of_a_steady_turn_are_mass_times_acceleration(share):
    com_x, com_y, friction, resistance, ratio = 0.02, -0.01, 0.6, 0.1, 0.7
    speed = np.array([0.8, 0.3, 0.8, 0.3])
    runs = ground(COM_X=com_x, COM_Y=com_y, FRICTION=friction, RESISTANCE=resistance,
                  LATERAL_SHARE=share, LATERAL_RATIO=ratio)
    last = simulate(np.tile(speed, (2000, 1)), runs)[0, -1]
    u, v, w = last[:model.A_X]
    acceleration = np.array([-w * v, w * u, 0.0])
    np.testing.assert_allclose(last[model.A_X:model.FORCE], acceleration, atol=1e-9)
    # brush tires, PHYSICS.md B and D
    x, y = X - com_x, Y - com_y
    load = 0.25 * MASS * (GRAVITY + (GRAVITY * com_x - HEIGHT * acceleration[0]) / X
                          + (GRAVITY * com_y - HEIGHT * acceleration[1]) / Y)
    velocity = np.stack([u - y * w, v + x * w])
    slip = np.stack([speed - velocity[0], -ratio * velocity[1]]) / speed
    total = np.hypot(*slip)
    t = np.minimum(1200.0 * total / (3.0 * friction * load), 1.0)
    tread = friction * load * (1.0 - (1.0 - t)**3) * slip / total
    drag = resistance * load * (share * velocity / np.hypot(*velocity) + np.stack(
        [(1.0 - share) * np.sign(velocity[0]), np.zeros(4)]))
    force = tread * [[1.0], [1.0]] - drag
    np.testing.assert_allclose(last[FORCES], tread[0], atol=1e-8)
    np.testing.assert_allclose(
        [force[0].sum(), force[1].sum(), (x * force[1] - y * force[0]).sum()],
        [MASS * acceleration[0], MASS * acceleration[1], 0.0], atol=1e-8)


def test_locked_wheels_brake_by_their_friction():
    out = simulate(np.zeros((30, 4)), ground(FRICTION=0.5, START_U=3.0))[0]
    np.testing.assert_allclose(out[15:, model.A_X], -0.5 * GRAVITY, rtol=1e-6)


def test_sliding_friction_falls_with_the_slip():
    fall, friction, load = 0.4, 0.5, 0.25 * MASS * GRAVITY
    for stiffness in (80.0, 200.0, 1200.0):  # N; wheels of 8 m/s, robot at rest: slip ratio 1
        force = simulate(np.full((1, 4), 8.0), ground(
            FRICTION=friction, FALL=fall, STIFFNESS=stiffness))[0, 0, FORCES]
        t = stiffness / (3.0 * friction * load)
        np.testing.assert_allclose(
            force, friction * load * (1.0 - fall * (1.0 - 1.0 / t)), rtol=0.02)
    # and not before full sliding: a slip of 1 %
    grip, fallen = (simulate(np.full((300, 4), 1.0), ground(FALL=share, RESISTANCE=0.05))
                    for share in (0.0, fall))
    np.testing.assert_array_equal(grip[0, -1], fallen[0, -1])


def test_the_slope_changes_linearly_from_begin_to_end():
    """Locked wheels that hold: forces carry the weight along the slope."""
    out = simulate(np.zeros((400, 4)), ground(FRICTION=1.0, SLOPE_X=0.02, BEND_X=0.04,
                                              SLOPE_Y=-0.01, BEND_Y=0.02))[0]
    for n in (100, 200, 399):
        part = (n + 0.5) / 400 - 0.5
        np.testing.assert_allclose(
            out[n, [model.A_X, model.A_Y]],
            [GRAVITY * (0.02 + 0.04 * part), GRAVITY * (-0.01 + 0.02 * part)], atol=0.01)


def test_locked_wheels_take_energy_only():
    random = np.random.default_rng(3)
    runs = ground(50, RESISTANCE=0.05, LATERAL_SHARE=0.5)
    runs[:, VELOCITY] = random.uniform(-1.0, 1.0, (50, 3)) * [1.0, 1.0, 5.0]
    velocity = np.concatenate([runs[:, np.newaxis, VELOCITY],
                               simulate(np.zeros((200, 4)), runs)[..., :model.A_X]], axis=1)
    energy = 0.5 * velocity**2 @ [MASS, MASS, INERTIA]
    assert (np.diff(energy) <= 1e-3 * energy[:, :1]).all()  # the last step before it stands
    assert (energy[:, -1] <= 1e-9 * energy[:, 0]).all()


def test_a_lifted_wheel_has_no_force():
    robot = ROBOT.copy()
    robot[model.HEIGHT] = 0.5
    forces = simulate(np.full((6, 4), 2.0), ground(FRICTION=1.0), robot=robot)[0, 1:, FORCES]
    assert (forces[:, :2] == 0.0).all()
    assert (forces[:, 2:] > 0.0).all()


@pytest.mark.parametrize('wheel', range(4))
def test_in_a_lift_the_others_carry_the_weight_and_its_moments(wheel):
    rolling = np.tile([0.9, 0.5, 0.9, 0.5], (60, 1))
    com_x, com_y = -0.02 * np.sign([X[wheel], Y[wheel]])  # towards the wheel across
    runs = ground(START_U=0.6, COM_X=com_x, COM_Y=com_y, MOVED_LOAD=-1.0)
    plain = simulate(rolling, runs)[0]
    for slot in (0, 3):
        lifted = runs.copy()
        lifted[0, model.LIFT + slot:model.LIFT + slot + 3] = wheel, 20, 40
        out = simulate(rolling, lifted)[0]
        np.testing.assert_array_equal(out[:20], plain[:20])
        assert (out[20] != plain[20]).any()
        during, after = out[20:40, LOADS], out[40:, LOADS]
        assert (during[:, wheel] == 0.0).all() and (out[20:40, model.FORCE + wheel] == 0.0).all()
        assert (during[:, [1, 0, 3, 2][wheel]] > 0.35 * MASS * GRAVITY).all()
        assert (after > 0.1 * MASS * GRAVITY).all()
        np.testing.assert_allclose(during.sum(axis=1), MASS * GRAVITY)
        for arm, column in ((X - com_x, model.A_X), (Y - com_y, model.A_Y)):
            np.testing.assert_allclose(
                during @ arm, -MASS * HEIGHT * out[20:40, column], atol=1e-9)


@pytest.mark.parametrize(('share', 'across', 'next_to'), [(0.2, 1.2, 0.8), (0.0, 1.0, 1.0)])
def test_what_lifts_a_wheel_may_raise_its_corner(share, across, next_to):
    runs = ground(MOVED_LOAD=share)
    runs[0, model.LIFT:model.LIFT + 3] = 1, 0, np.inf
    loads = simulate(np.zeros((3, 4)), runs)[0, -1, LOADS]
    np.testing.assert_allclose(
        loads, 0.25 * MASS * GRAVITY * np.array([next_to, 0.0, across, next_to]))


def test_errors_decrease_with_the_square_of_the_step():
    def end(parts: int) -> np.ndarray:
        robot = ROBOT.copy()
        robot[[model.TIME_STEP, model.HEIGHT]] = STEP / parts, 0.0  # loads lag by one step
        time = np.arange(1, 60 * parts + 1)[:, np.newaxis] * STEP / parts
        rolling = 0.6 + np.array([0.2, -0.1, 0.2, -0.1]) * np.sin(3.0 * time)**2
        return simulate(rolling, ground(START_U=0.6, COM_X=0.02), robot=robot)[0, -1, :model.A_X]

    exact = end(64)
    errors = [np.abs(end(parts) - exact).max() for parts in (1, 2, 4)]
    assert errors[0] < 1e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.4)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2.0, abs=0.4)


def test_forces_follow_the_slip_over_the_relaxation_length():
    length, speed, steps = 0.1, 0.5, 60
    rolling = np.full((steps, 4), speed)
    rolling[20:] *= 1.001  # a small step of the slip, and a body that does not follow it
    robot = ROBOT.copy()
    robot[model.MASS] = 1e9
    runs = ground(RELAXATION=length, STIFFNESS=1.0, OLD_STIFFNESS=1.0, OLD_FRICTION=0.6)
    runs[:, model.START_U] = speed
    force = simulate(rolling, runs, robot=robot)[0, :, model.FORCE]
    after = STEP * np.arange(1, steps - 19)
    expected = 1.0 - (1.0 + STEP * speed / length) ** (-after / STEP)  # implicit Euler
    np.testing.assert_allclose(force[20:] / force[-1] * expected[-1], expected, rtol=0.02)
    assert abs(after[np.searchsorted(expected, 1.0 - np.exp(-1.0))] * speed - length) < 0.02


def test_a_relaxing_tire_takes_energy_only_and_comes_to_rest():
    runs = ground(RELAXATION=0.03, OLD_STIFFNESS=1200.0, OLD_FRICTION=0.6)
    runs[:, VELOCITY] = 0.3, 0.1, 0.5
    states = simulate(np.zeros((400, 4)), runs)[0]
    speed = np.hypot(states[:, model.U], states[:, model.V])
    assert speed.max() < 0.32 and speed[-50:].max() < 0.01
