# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What a scene shows: values, bounds, units, gaps, changes of the ground, shapes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.estimation.friction.estimator import FrictionEstimator
from smart_tire.messages import NodeStatus, TOPICS
from smart_tire.parameters import build, FrictionEstimatorParams
from smart_tire.samples import (
    FilmCharge, FilmDeflection, FilmTemperature, Friction, FrictionGrid, GoalPose, GroundState,
    MotorCommand, PathProgress, PlannedPath, TireSample, VelocityCommand, WheelCommand, WHEELS,
    WheelSample, WheelSlip)
from smart_tire.uncertain import Uncertain
from smart_tire.view.contact import thinned
from smart_tire.view.writer import TRUTH, ViewWriter, WHEEL_COLORS
from support import ideal_robot

START = 1_700_000_000_000_000_000  # ns; times in the viewer are those since the first sample
MS = 1_000_000


def odometry(time_ms, x, y=0.0, *, yaw=0.0, v_x=1.0, variance=0.0):
    return ideal_robot.odometry(START + time_ms * MS, x, y, yaw, v_x, variance=variance)


def slip(time_ms, ratio, sigma, velocity=0.0):
    return WheelSlip(START + time_ms * MS, ratio, (velocity,) * 4, sigma)


SHOWN = [  # topic, sample, path -> shown values; None is a gap
    ('wheel_slip', slip(0, (0.1, 0.2, math.nan, 0.4), (0.01, math.inf, 1.0, 0.51)), {
        'slip/front_left/estimate': [0.1, 0.08, 0.12], 'slip/front_right/estimate': [None] * 3,
        'slip/rear_left/estimate': [None] * 3, 'slip/rear_right/estimate': [None, None, None]}),
    ('ground_truth/wheel_slip', slip(0, (0.11, 0.2, 0.3, math.nan), (0.0,) * 4), {
        'slip/front_left/truth': [0.11], 'slip/rear_right/truth': [None]}),
    ('film_charge', FilmCharge(START, -2e-9), {'film_signals/charge': [-2e-9]}),
    ('film_temperature', FilmTemperature(START, 21.0), {'film_signals/temperature': [21.0]}),
    ('film_deflection', FilmDeflection(START, Uncertain(0.004, 0.0005)), {
        'film/deflection': [0.004, 0.003, 0.005]}),
    ('ground_truth/film_deflection', FilmDeflection(START, Uncertain(0.004, 0.0)), {
        'film/truth': [0.004]}),
    ('tire_friction', Friction(
        START, 'front_left', friction_coefficient=Uncertain(0.5, 0.05),
        friction_coefficient_single=Uncertain(0.6, 0.1), stiffness=Uncertain(50.0, 5.0),
        traction_force=Uncertain(4.0, 1.0)), {
            'friction/front_left/fused': [0.5, 0.4, 0.6], 'friction/front_left/single': [0.6],
            'friction/front_left/single_bound/down': [0.4],
            'friction/front_left/single_bound/up': [0.8],
            'traction/front_left/crossing': [4.0], 'stiffness/front_left': [50.0]}),
    ('ground_truth/tire_friction', Friction(
        START, 'front_left', friction_coefficient=Uncertain(0.47, 0.0)), {
            'friction/front_left/truth': [0.47]}),
    ('ground_state', GroundState(START, Uncertain(52.0, 3.0),
                                 rolling_resistance=Uncertain(0.02, 0.004)), {
        'stiffness/ground': [52.0, 46.0, 58.0],
        'rolling_resistance/ground': [0.02, 0.012, 0.028]}),
    ('cmd_vel', VelocityCommand(START, 0.6, -0.3), {
        'body/velocity/command': [0.6], 'body/yaw_rate/command': [-0.3]}),
    ('odom', odometry(0, 0.0, v_x=0.5, variance=0.01), {
        'body/velocity/estimate': [0.5, 0.3, 0.7]}),
    ('wheel_commands', WheelCommand(START, (1.0, 2.0, 3.0, 4.0)), {
        'wheels/set_point/rear_left': [3.0]}),
    ('motor_commands', MotorCommand(START, (0.1, 0.2, 0.3, 0.4)), {
        'wheels/duty/rear_right': [0.4]}),
    ('wheel_states', WheelSample(START, (5.0,) * 4, effort=(0.5, math.nan, 0.7, 0.8)), {
        'wheels/torque/front_left': [0.5], 'wheels/torque/front_right': [None],
        'wheels/speed/rear_left': [5.0]}),
    ('path_progress', PathProgress(START, 2.5, -0.125, 1), {
        'progress/state': [1.0], 'progress/cross_track_error': [-0.125],
        'progress/remaining_distance': [2.5]}),
    ('path_progress', PathProgress(START, math.nan, math.nan, 2), {
        'progress/state': [2.0], 'progress/cross_track_error': [None]})]


@pytest.mark.parametrize(('topic', 'sample', 'shown'), SHOWN, ids=[row[0] for row in SHOWN])
def test_values_are_shown_with_bounds_of_two_sigmas_and_gaps(recorded, topic, sample, shown):
    found = recorded(lambda scene: scene.add_sample(topic, sample))
    for path, expected in shown.items():
        [(time, values)] = found.scalars(path)
        assert time == 0
        assert [None if math.isnan(value) else value for value in values] == [
            None if value is None else pytest.approx(value) for value in expected], path


def test_of_an_unknown_friction_no_single_point_is_shown(recorded):
    unknown = Friction(START, 'front_left')
    found = recorded(lambda scene: scene.add_sample('tire_friction', unknown))
    assert np.isnan(found.scalars('friction/front_left/fused')[0][1]).all()
    for path in ('friction/front_left/single', 'friction/front_left/single_bound/up',
                 'traction/front_left/crossing', 'stiffness/front_left'):
        assert found.scalars(path) == []


def test_series_have_names_with_units_and_the_color_of_their_wheel(recorded):
    def feed(scene):
        for topic, sample, _ in SHOWN:
            scene.add_sample(topic, sample)

    found = recorded(feed)
    for wheel in WHEELS:
        names = found.static(f'slip/{wheel}/estimate', 'SeriesLines:names')
        assert names == [f'{wheel} [-]', f'{wheel} [-] - 2 σ', f'{wheel} [-] + 2 σ']
        speed = f'wheels/speed/{wheel}'
        assert found.static(speed, 'SeriesLines:names') == [f'{wheel}, measured [rad/s]']
        assert rgb(found, speed) == rgb(found, f'slip/{wheel}/estimate') == WHEEL_COLORS[wheel]
        assert rgb(found, f'slip/{wheel}/truth') == TRUTH
    for path in ('body/velocity/command', 'wheels/set_point/rear_left'):
        assert found.static(path, 'SeriesLines:interpolation_mode')


def rgb(found, path):
    color = found.static(path, 'SeriesLines:colors')[0]
    return color >> 24 & 255, color >> 16 & 255, color >> 8 & 255


def test_the_true_path_starts_at_the_estimated_pose(recorded):
    def feed(scene):
        scene.add_sample('ground_truth/odom', odometry(0, 7.0, 7.0))
        scene.add_sample('odom', odometry(0, 1.0, 2.0, yaw=math.pi / 2))
        for step in range(1, 60):
            scene.add_sample('odom', odometry(10 * step, 1.0, 2.0 + 0.01 * step, yaw=math.pi / 2))
            scene.add_sample('ground_truth/odom', odometry(10 * step, 7.0 + 0.01 * step, 7.0))

    found = recorded(feed)
    component = 'LineStrips2D:strips'
    truth, estimate = (np.concatenate([np.concatenate(value) for _, value in found.rows(
        path, component)]) for path in ('path/truth', 'path/estimate'))
    assert truth[0] == pytest.approx((1.0, -2.01), abs=0.011)   # y is up, so -y on the screen
    assert truth[-1] == pytest.approx((1.0, -2.59), abs=0.011)
    assert estimate[-1] == pytest.approx((1.0, -2.59), abs=0.006)
    assert len(found.rows('path/estimate', component)) == 2  # a segment of half a second, a rest


def test_a_truth_without_estimate_is_shown_as_it_is(recorded):
    def feed(scene):
        for step in range(20):
            scene.add_sample('ground_truth/odom', odometry(10 * step, 5.0 + 0.1 * step, 1.0))

    strips = recorded(feed).rows('path/truth', 'LineStrips2D:strips')
    assert strips[0][1][0][0] == pytest.approx((5.0, -1.0))
    assert strips[-1][1][-1][-1] == pytest.approx((6.9, -1.0))


def test_friction_circles_and_forces_obey_the_brush_model(recorded):
    def feed(scene):
        scene.add_sample('tire_friction', Friction(
            START, 'front_left', friction_coefficient=Uncertain(0.5, 0.05)))
        scene.add_sample('ground_state', GroundState(START, Uncertain(60.0, 3.0)))
        scene.add_sample('odom', odometry(0, 0.0, v_x=0.9))
        scene.add_sample('wheel_slip', slip(0, (0.1,) * 4, (0.01,) * 4, velocity=0.1))

    found = recorded(feed)
    limit = 0.5 * 10.9 * 9.80665 / 4.0  # a quarter of the weight
    t = 0.1 * 60.0 / (3.0 * limit)
    force = 60.0 * 0.1 * (1.0 - t + t * t / 3.0)
    assert found.scalars('traction/rear_right/model')[0][1] == pytest.approx([force], rel=1e-3)
    assert found.scalars('friction_used/rear_right')[0][1] == pytest.approx(
        [force / limit], rel=1e-3)
    vectors = found.rows('forces/arrows', 'Arrows2D:vectors')[0][1]
    assert vectors[0] == pytest.approx((0.0, -force), rel=1e-3)  # forward is up
    circle = np.array(found.rows('forces/circles', 'LineStrips2D:strips')[0][1][0])
    assert np.ptp(circle, axis=0) == pytest.approx((2.0 * limit,) * 2, rel=1e-3)
    labels = found.rows('forces/circles', 'Points2D:labels')[0][1]
    assert labels[0] == 'front_left: mu F_z 13 N'
    assert labels[3] == 'rear_right: mu F_z 13 N\nwith mu of front_left'


def test_no_forces_are_shown_before_a_friction_coefficient_is_known(recorded):
    def feed(scene):
        scene.add_sample('odom', odometry(0, 0.0, v_x=0.9))
        scene.add_sample('wheel_slip', slip(0, (0.1,) * 4, (0.01,) * 4, velocity=0.1))

    assert not recorded(feed).rows('forces/arrows', 'Arrows2D:vectors')


def test_counts_are_summed_over_nodes_and_states_become_events(recorded):
    def feed(scene):
        scene.add_sample('wheel_slip', slip(0, (0.1,) * 4, (0.01,) * 4))
        for time_ms, node, level, message, values in (
                (0, 'a', 0, 'ok', {'frames_bad': '1', 'last_message_age': '0.5', 'state': 'x'}),
                (100, 'ns/b', 0, 'ok', {'frames_bad': '2', 'odom.last_message_age': 'inf'}),
                (200, 'a', 2, 'no port', {'frames_bad': '4'}), (300, 'a', 2, 'no port', {})):
            scene.add_status(START + time_ms * MS, NodeStatus(node, level, message, values))

    found = recorded(feed)
    assert found.scalars('links/total/frames_bad') == [
        (0, [1.0]), (100 * MS, [3.0]), (200 * MS, [6.0])]
    assert found.scalars('links/counts/a/frames_bad') == [(0, [1.0]), (200 * MS, [4.0])]
    assert found.scalars('links/ages/a') == [(0, [0.5])]
    assert np.isnan(found.scalars('links/ages/ns/b/odom')[0][1]).all()
    events = [(text[0], level[0]) for (_, text), (_, level) in zip(
        found.rows('links/events', 'TextLog:text'), found.rows('links/events', 'TextLog:level'))]
    assert events == [('a: ok', 'INFO'), ('ns/b: ok', 'INFO'), ('a: no port', 'ERROR')]


def test_a_wanted_path_and_a_goal_are_shown_from_the_next_estimate_on(recorded):
    def feed(scene):
        scene.add_sample('path', PlannedPath(
            0, 'odom', ((0.0, 0.0, math.nan), (2.0, 1.0, math.nan))))
        scene.add_sample('odom', odometry(0, 0.0))
        scene.add_sample('goal_pose', GoalPose(0, 'odom', (1.0, -1.0, 0.0)))
        scene.add_sample('odom', odometry(100, 0.1))
        scene.add_sample('path', PlannedPath(START + 150 * MS, 'odom', ()))

    found = recorded(feed)
    strips, goals = (found.rows(path, component) for path, component in (
        ('path/wanted', 'LineStrips2D:strips'), ('path/goal', 'Points2D:positions')))
    assert [time for time, _ in strips] == [time for time, _ in goals] == [0, 100 * MS, 150 * MS]
    assert [np.array(shapes).tolist() for _, shapes in strips] == [
        [[[0.0, 0.0], [2.0, -1.0]]], [], []]  # y points down on the screen
    assert [np.array(points).tolist() for _, points in goals] == [[[2.0, -1.0]], [[1.0, 1.0]], []]


def test_known_cells_of_a_friction_map_are_shown_where_they_are(recorded):
    def feed(scene):
        scene.add_sample('friction_map', FrictionGrid(
            START, 'odom', 0.5, (1.0, -2.0), 3, bytes([100, 255, 0, 255, 255, 50])))
        scene.add_sample('friction_map', FrictionGrid(START + MS, 'map', 0.5, (0.0, 0.0), 1, b'1'))

    found = recorded(feed)
    (_, centers), = found.rows('path/friction_map', 'Points2D:positions')
    assert np.array(centers).tolist() == [[1.25, 1.75], [2.25, 1.75], [2.25, 1.25]]
    (_, colors), = found.rows('path/friction_map', 'Points2D:colors')
    red = [color >> 24 for color in colors]
    assert red[1] < red[2] < red[0]


def test_every_topic_of_the_interface_is_shown(recorded):
    shown = []
    recorded(lambda scene: shown.extend(scene.topics))
    assert set(shown) == TOPICS.keys()


def test_thinning_keeps_every_sample_of_a_short_event():
    rest = [(i, 1.65 + 0.003 * (i % 3)) for i in range(20)]
    assert thinned(rest) == [(0, 1.65), (2, 1.656)]
    event = [*rest[:7], (7, 1.70), *rest[8:]]
    assert thinned(event) == event
    assert thinned([]) == []
    assert thinned([(3, 1.0)]) == [(3, 1.0)]


def test_a_lost_batch_interrupts_the_line_of_a_film(recorded):
    period = 2_500_000
    stamps = [START + i * period for i in (*range(30), *range(46, 60))]

    def feed(scene):
        for i, stamp_ns in enumerate(stamps):
            scene.add_sample('tire_samples', TireSample(stamp_ns, 'front_left', (i % 2, 1.0)))
            scene.add_sample('tire_samples', TireSample(stamp_ns, 'rear_left', (1.65, 1.65)))

    found = recorded(feed)
    assert len(found.scalars('films/rear_left/film_2')) < 8  # at rest: thinned, on its own
    rows = found.scalars('films/front_left/film_1')
    gaps = [time for time, (value,) in rows if math.isnan(value)]
    assert gaps == [29 * period + 1]
    assert len(rows) == len(stamps) + 1  # a signal of 1 V: no sample is left out


def test_a_scene_shows_each_crossing_with_its_samples_and_the_model(recorded):
    from support.rolling import films, in_order, steady, WHEEL, wheels
    course = steady(60.0)
    params = build(FrictionEstimatorParams, {'film.wheels': [WHEEL]})
    estimator = FrictionEstimator(params)
    names = {topic.sample: topic.name for topic in reversed(TOPICS.values())}
    crossings = []

    def feed(scene):
        for sample in in_order(films(course, 4.0), wheels(course, 4.0)):
            scene.add_sample(names[type(sample)], sample)
            for found in estimator.update(sample):
                crossings.append(found)
                scene.add_sample(names[type(found)], found)
        scene.add_sample('tire_friction', Friction(START, WHEEL))  # its samples are not there

    found = recorded(feed, **{'film.wheels': [WHEEL]})
    path = f'contact/{WHEEL}/waveforms'
    points, strips = (found.rows(path, component) for component in (
        'Points2D:positions', 'LineStrips2D:strips'))
    assert [time for time, _ in points] == [time for time, _ in strips]
    assert len(points) == len(crossings) >= 3
    for (_, measured), (_, models) in zip(points, strips):
        assert len(models) == 2
        assert distance_to_curves(np.array(measured), models) < 1.0  # of 30 mm per volt
    texts = sorted(found.rows(f'contact/{WHEEL}/result', 'TextDocument:text'))
    assert ['no samples' in text for _, (text,) in texts].count(True) == 1
    assert any('| adhesion ratio | 0.' in text for _, (text,) in texts)


def test_a_change_of_the_ground_is_marked_at_the_friction_of_then(recorded):
    def feed(scene):
        scene.add_sample('tire_friction', Friction(
            START, 'front_left', friction_coefficient=Uncertain(0.5, 0.05)))
        for time_ms, count in (0, '3'), (100, '3'), (200, '4'):
            scene.add_status(START + time_ms * MS, NodeStatus(
                'friction_estimator', 0, 'ok', {'ground_changes': count}))

    found = recorded(feed)
    assert found.scalars('friction/ground_change') == [(200 * MS, [0.5])]
    assert [text for _, (text,) in found.rows('links/events', 'TextLog:text')] == [
        'friction_estimator: ok', 'change of the ground']


def distance_to_curves(points, curves):
    """Return the rms distance in height of ``points`` from the nearest of ``curves``."""
    heights = [np.interp(points[:, 0], *np.array(curve).T) - points[:, 1] for curve in curves]
    return float(np.sqrt(np.mean(np.min(np.square(heights), axis=0))))


def test_times_count_from_the_first_stamp_also_for_late_samples():
    class Stream:

        def __init__(self):
            self.times = []

        def log(self, *_, **__):
            pass

        def flush(self):
            pass

        def send_columns(self, path, indexes, columns):
            self.times += [int(t) for t in indexes[0].times.cast('int64').to_pylist()]

    writer = ViewWriter(Stream())
    buffer = writer.line('a', 'a', TRUTH)
    writer.begin(START)
    buffer.add(START, 1.0)
    writer.flush()
    writer.begin(START - 5 * MS)
    buffer.add(START - 5 * MS, 1.0)
    writer.flush()
    assert writer.stream.times == [0, -5 * MS]
