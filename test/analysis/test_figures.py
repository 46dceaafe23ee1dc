# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Figures of a result: files, panels, units, axis limits, captions, and one crossing."""

from dataclasses import replace
import math

from animation import frames, save, until
import numpy as np
from PIL import Image
import pytest

from smart_tire.analysis.dead_reckoning import GYRO_WHEELS
from smart_tire.analysis.figures import (
    adhesion_figure, friction_figure, ground_figure, typical_crossings, write_figures)
from smart_tire.analysis.motion_figures import (
    equidistant, path_figure, slip_figure, velocity_figure, wheel_slip_figure, wheel_speed_figure)
from smart_tire.analysis.result import Result
from smart_tire.parameters import RobotParams
from smart_tire.recording import SampleArrays
from smart_tire.samples import (
    Friction, FRICTION_QUANTITIES, GROUND_ESTIMATES, GroundState, NS_PER_S, TireSample,
    WheelSample, WheelSlip)
from smart_tire.uncertain import Uncertain, UNKNOWN
from support.driving import driven
from support.ideal_robot import odometry

EPOCH = 1_700_000_000 * NS_PER_S
ROBOT = RobotParams()
OMEGA = 2.0 * math.pi  # rad/s, 60 rpm


def ns(time_s):
    return EPOCH + round(time_s * NS_PER_S)


def estimated():
    """Return four seconds of poses and slips, and crossings at 1, 2 and 3 s."""
    series = driven(begin_ns=EPOCH, slip=(0.1, -0.1) * 2)
    for time, slip, sigma in ((1.0, 0.10, 0.05), (2.0, 0.12, 0.9), (3.0, 0.2, 0.05)):
        series.add_sample(Friction(
            ns(time), 'front_left', friction_coefficient=Uncertain(0.47, 0.03),
            friction_coefficient_single=Uncertain(0.5, sigma), slip=Uncertain(slip, 0.0)))
    series.add_sample(GroundState(ns(1.0), Uncertain(50.0, 5.0)))
    return series


def measured():
    """Return four seconds of film voltages and wheel speeds."""
    series = SampleArrays()
    for i in range(1600):
        series.add_sample(TireSample(ns(i / 400), 'front_left', (1.65 + 0.001 * i, 1.65)))
    for i in range(64):
        series.add_sample(WheelSample(ns(i / 16), (OMEGA,) * 4))
    return series


def result(**changes):
    return Result(**{'estimates': estimated(), 'inputs': measured(), 'truth': estimated(),
                     **changes})


def only(crossings=(), slips=()):
    series = SampleArrays()
    series.crossings = list(crossings)
    for slip in slips:
        series.add_sample(slip)
    return series


def labels(panel):
    return [mark.label for mark in panel.marks]


def titles(figure):
    return [panel.title for panel in figure.panels]


def test_what_was_estimated_is_written(tmp_path):
    written = write_figures(tmp_path / 'new', result(), ROBOT)
    assert [path.name for path in written] == [
        'slip.png', 'path.png', 'friction.png', 'crossing.png']
    assert all(path.read_bytes().startswith(b'\x89PNG') for path in written)
    assert write_figures(tmp_path, Result(SampleArrays(), measured()), ROBOT) == []


def test_every_axis_has_a_unit_and_every_band_an_explanation():
    found = result()
    drawn = [draw(found) for draw in (
        slip_figure, wheel_slip_figure, path_figure, friction_figure, adhesion_figure,
        ground_figure, velocity_figure, wheel_speed_figure)]
    for figure in drawn:
        for panel in figure.panels:
            assert all(text.endswith(']') and '[' in text
                       for text in (panel.x_label, panel.y_label)), figure.name
        banded = any(mark.curve.sigma is not None
                     for panel in figure.panels for mark in panel.marks)
        assert banded == ('reports' in figure.caption), figure.name
    assert all(draw(Result(SampleArrays())) is None for draw in (
        slip_figure, wheel_slip_figure, path_figure, friction_figure, adhesion_figure,
        ground_figure, velocity_figure, wheel_speed_figure))


def test_the_panels_of_the_ground_show_stiffness_and_rolling_resistance():
    state = GroundState(ns(1.0), *(Uncertain(value, 0.01) for value in (50.0, 0.4, 0.02)))
    figure = ground_figure(result(estimates=SampleArrays([state])))
    assert [panel.marks[0].curve.y.tolist() for panel in figure.panels] == [[50.0], [0.02]]


def test_every_panel_shows_the_quantity_that_it_names():
    numbers = iter(range(1, 100))
    states = {name: 0.01 * next(numbers) for name in GROUND_ESTIMATES}
    crossing = {name: 0.01 * next(numbers) for name in FRICTION_QUANTITIES}
    slips, speeds = ((0.11, 0.12, 0.13, 0.14), (1.1, 1.2, 1.3, 1.4))
    found = SampleArrays()
    for i in range(3):
        found.add_sample(odometry(ns(i), 0.5, -0.5, 0.05, 0.21, 0.23, v_y=0.22))
        found.add_sample(WheelSlip(ns(i), slips, (0.9,) * 4, (0.02,) * 4))
        found.add_sample(GroundState(ns(i), **{
            name: Uncertain(value, 1e-4) for name, value in states.items()}))
        found.add_sample(Friction(ns(i), 'rear_left', **{
            name: Uncertain(value, 1e-4) for name, value in crossing.items()}))
    drawn = Result(found, SampleArrays(WheelSample(ns(i), speeds) for i in range(3)))
    expected = {
        slip_figure: [[0.12, 0.13]], wheel_slip_figure: [[one] for one in slips],
        velocity_figure: [[0.21], [0.22], [0.23]], wheel_speed_figure: [[*speeds]],
        friction_figure: [[crossing['friction_coefficient_single'],
                           crossing['friction_coefficient']]],
        adhesion_figure: [[crossing['adhesion_ratio']]],
        ground_figure: [[states['stiffness']], [states['rolling_resistance']]]}
    for draw, panels in expected.items():
        shown = [[one.curve.y[0] for one in panel.marks if one.label]
                 for panel in draw(drawn).panels]
        assert shown == [pytest.approx(panel) for panel in panels], draw.__name__
    path, = path_figure(drawn).panels
    assert [(one.curve.x[0], one.curve.y[0]) for one in path.marks if one.label == 'estimate'] == [
        (0.5, -0.5)]


def test_each_interval_has_a_slip_panel_and_determines_the_axis():
    estimates = estimated()
    for k in range(100):
        estimates.add_sample(WheelSlip(ns(4.0 + 0.01 * k), (0.9,) * 4, (0.0,) * 4, (0.02,) * 4))
    intervals = {name: [(ns(start), ns(start + 1.0))] for name, start in
                 (('concrete', 0.0), ('sand', 1.0), ('sand again', 2.0))}
    figure = slip_figure(result(estimates=estimates, intervals=intervals))
    assert titles(figure) == ['concrete', 'sand', 'sand again']
    assert [panel.x_limits for panel in figure.panels] == [(0.0, 1.0), (1.0, 2.0), (2.0, 3.0)]
    assert figure.rows[1][1] is None and figure.segments == ()
    assert figure.panels[0].y_limits[1] < 0.3
    assert slip_figure(result(estimates=estimates)).panels[0].y_limits[1] > 0.9


def test_filtered_and_smoothed_motion_is_drawn_and_friction_once():
    found = result(smoothed=estimated())
    assert titles(slip_figure(found)) == ['filtered', 'smoothed']
    assert titles(friction_figure(found)) == ['front left']
    path, *errors = path_figure(found).panels
    assert labels(path) == ['2σ of the position', 'filtered', '2σ of the position', 'smoothed',
                            'truth', 'start', 'end']
    assert [panel.y_label for panel in errors] == ['position error [m]', 'heading error [rad]']
    assert [[mark.color for mark in panel.marks] for panel in errors] == [['orange', 'blue']] * 2


def test_gyroscope_and_wheels_are_drawn_below_the_estimates_with_their_errors():
    found = result(dead_reckoning={GYRO_WHEELS: estimated().poses()})
    path, *errors = path_figure(found).panels
    assert labels(path)[:2] == [GYRO_WHEELS, '2σ of the position']
    assert [labels(panel) for panel in errors] == [['estimate', GYRO_WHEELS]] * 2
    assert np.isnan(errors[0].marks[1].curve.sigma).all()
    assert GYRO_WHEELS not in labels(path_figure(replace(found, truth=SampleArrays())).panels[0])


def test_wanted_paths_are_below_the_others():
    wanted = [np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([[1.0, 0.0], [1.0, 1.0]])]
    for truth in (estimated(), SampleArrays()):
        marks = path_figure(result(truth=truth, wanted=wanted)).panels[0].marks
        assert [(mark.label, mark.curve.x.tolist()) for mark in marks[:2]] == [
            ('wanted', path[:, 0].tolist()) for path in wanted]


def test_ground_truth_is_drawn_if_available():
    for draw in (slip_figure, wheel_slip_figure, friction_figure, adhesion_figure,
                 velocity_figure):
        for truth, expected in ((estimated(), True), (SampleArrays(), False)):
            figure = draw(result(truth=truth))
            assert ('truth' in labels(figure.panels[0])) == expected
            assert ('Dashed' in figure.caption) == expected


@pytest.mark.parametrize('slip', [1.0, math.nan])
def test_neither_a_spike_nor_an_undefined_slip_changes_the_slip_axis(slip):
    spiky = estimated()
    spiky.add_sample(WheelSlip(ns(4.0), (slip,) * 4, (0.0,) * 4, (0.02,) * 4))
    low, high = slip_figure(result(estimates=spiky)).panels[0].y_limits
    assert -0.3 < low < -0.1 and 0.1 < high < 0.3
    low, high = slip_figure(Result(only(slips=[WheelSlip(
        ns(i), (math.nan,) * 4, (0.0,) * 4, (1.0,) * 4) for i in range(9)]))).panels[0].y_limits
    assert low < 0.0 < high


def test_uninformative_single_crossings_and_gaps_are_not_drawn_but_counted():
    crossings = [Friction(
        ns(time), 'front_left', friction_coefficient=Uncertain(0.5, 0.03),
        friction_coefficient_single=Uncertain(value, sigma), slip=Uncertain(0.1, 0.0))
        for time, value, sigma in ((20.0, 0.5, 0.05), (21.0, 2.0, 0.05), (22.0, 0.5, 0.9),
                                   (91.0, 0.5, 0.05))]
    figure = friction_figure(Result(only(crossings)))
    single, fused = figure.panels[0].marks
    assert np.isnan(single.curve.y).tolist() == [False, False, True, False]
    assert np.isnan(fused.curve.y).tolist() == [False, False, False, True, False]
    assert '1 of 4 single crossings' in figure.caption
    assert '33.3 % of the others are outside' in figure.caption


def test_slip_has_no_line_at_standstill_and_where_it_is_unknown():
    slips = []
    for i in range(1200):
        time = 0.1 * i
        sigma = 1.0 if 60.0 <= time < 61.0 else 0.02
        ratio = math.nan if 40.0 <= time < 60.0 else -1.0 if sigma == 1.0 else 0.1
        slips.append(WheelSlip(ns(time), (ratio,) * 4, (0.0,) * 4, (sigma,) * 4))
    for figure in (slip_figure(Result(only(slips=slips))),
                   wheel_slip_figure(Result(only(slips=slips)))):
        curve = figure.panels[0].marks[0].curve
        assert np.nanmin(curve.y) == pytest.approx(0.1)
        assert np.isnan(curve.y[(curve.x >= 40.0) & (curve.x < 61.0)]).all()
        assert figure.panels[0].y_limits == pytest.approx((0.0, 0.2))
        assert '(1.0 % of the values)' in figure.caption


def test_a_long_recording_has_segments_where_the_wheels_change():
    inputs = SampleArrays()
    for i in range(1200):
        turning = 200 <= i < 250 or 900 <= i < 950
        inputs.add_sample(WheelSample(ns(0.1 * i), (OMEGA + (i % 2 if turning else 0.0),) * 4))
    found = result(inputs=inputs)
    assert len(found.segments) == 2
    assert slip_figure(found).segments == friction_figure(found).segments == found.segments
    assert result().segments == Result(estimated()).segments == []


def test_a_path_is_thinned_at_equal_distances_and_keeps_its_ends():
    travel = np.concatenate([np.zeros(5000), np.linspace(0.0, 10.0, 20_000)])
    path = np.column_stack([travel, np.zeros(len(travel))])
    rows = equidistant(path, 101)
    assert len(rows) <= 101 and rows[0] == 0 and rows[-1] == len(path) - 1
    assert np.diff(path[rows, 0]).max() < 0.11
    assert equidistant(np.zeros((10_000, 2)), 100).tolist() == [0, 9999]


def test_the_crossing_shown_is_one_in_traction_with_median_slip():
    crossings = estimated().crossings
    crossings.append(Friction(ns(3.5), 'front_left', slip=Uncertain(-0.12, 0.0)))
    assert next(typical_crossings(crossings)).slip.value == 0.12
    assert [p.slip.value for p in typical_crossings([
        Friction(ns(1.0), 'front_left', slip=slip)
        for slip in (UNKNOWN, Uncertain(-0.1, 0.0))])] == [-0.1]
    assert list(typical_crossings([])) == []


def test_an_animation_has_a_frame_for_each_second(tmp_path):
    pictures = frames(result(dead_reckoning={GYRO_WHEELS: estimated().poses()}))
    save(pictures, tmp_path / 'a.gif')
    with Image.open(tmp_path / 'a.gif') as written:
        assert written.n_frames == len(pictures) == 3
        assert written.size == pictures[0].size
    assert all(first.tobytes() != second.tobytes()
               for first, second in zip(pictures, pictures[1:]))
    with pytest.raises(SystemExit, match='no ground truth'):
        frames(result(truth=SampleArrays()))


def test_a_frame_shows_the_past_only():
    panel = slip_figure(result()).panels[0]
    shown = until(panel, 2.0, (0.0, 4.0))
    assert shown.x_limits == (0.0, 4.0)
    for before, mark in zip(panel.marks, shown.marks, strict=True):
        assert before.curve.x.max() > 2.5
        assert 1.9 < mark.curve.x.max() <= 2.0
        assert len(mark.curve.sigma if mark.curve.sigma is not None else mark.curve.y) == len(
            mark.curve.x)
