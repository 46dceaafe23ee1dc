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

"""Figures: files, panels, labels with units, axis limits."""

import math

import numpy as np
import pytest

from smart_tire.analysis import figures
from smart_tire.analysis.friction_figures import friction_curve
from smart_tire.analysis.labels import label_estimates
from smart_tire.analysis.series import Series
from smart_tire.parameters import RobotParams
from smart_tire.samples import Friction, NS_PER_S, Odometry, TireSample, WheelSample, WheelSlip
from smart_tire.uncertain import Uncertain, UNKNOWN

EPOCH = 1_700_000_000 * NS_PER_S
ROBOT = RobotParams()
OMEGA = 2.0 * math.pi  # rad/s, 60 rpm
SPREAD = tuple(0.01 if i % 7 == 0 else 0.0 for i in range(36))


def ns(time_s):
    return EPOCH + round(time_s * NS_PER_S)


def driven():
    """Return four seconds of poses and slips, and crossings at 1, 2 and 3 s."""
    series = Series()
    for i in range(400):
        series.add(Odometry(ns(0.01 * i), (0.005 * i, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0),
                            (0.5, 0.0, 0.0), (0.0, 0.0, 0.0), SPREAD, SPREAD))
        series.add(WheelSlip(ns(0.01 * i), (0.1, -0.1) * 2, (0.0,) * 4, (0.02,) * 4))
    for time, slip, sigma in ((1.0, 0.10, 0.05), (2.0, 0.12, 0.9), (3.0, 0.2, 0.05)):
        series.add(Friction(
            ns(time), 'front_left', friction_coefficient=Uncertain(0.47, 0.03),
            friction_coefficient_single=Uncertain(0.5, sigma), slip=Uncertain(slip, 0.0)))
    return series


def measured(lost=(9.0, 9.0)):
    """Return four seconds of film voltages and wheel speeds without those in ``lost`` [s]."""
    series = Series()
    for i in range(1600):
        if not lost[0] <= i / 400 <= lost[1]:
            series.add(TireSample(ns(i / 400), 'front_left', (1.65 + 0.001 * i, 1.65)))
    for i in range(64):
        series.add(WheelSample(ns(i / 16), (OMEGA,) * 4))
    return series


def texts(ax):
    return ax.get_xlabel(), ax.get_ylabel()


def test_all_figures_are_written_with_complete_data(tmp_path):
    written = figures.write_figures(tmp_path / 'new', measured(), driven(), driven(), ROBOT)
    assert [path.name for path in written] == [
        'slip.png', 'path.png', 'friction.png', 'crossing.png']
    assert all(path.read_bytes().startswith(b'\x89PNG') for path in written)


def test_only_what_was_estimated_is_drawn(tmp_path):
    bare = driven()
    bare.crossings.clear()
    written = figures.write_figures(tmp_path, Series(), bare, Series(), ROBOT)
    assert [path.name for path in written] == ['slip.png', 'path.png']
    assert figures.write_figures(tmp_path, measured(), Series(), Series(), ROBOT) == []


def test_friction_is_drawn_without_slip_and_path(tmp_path):
    alone = Series()
    alone.crossings = driven().crossings
    written = figures.write_figures(tmp_path, measured(), alone, Series(), ROBOT)
    assert [path.name for path in written] == ['friction.png', 'crossing.png']


def test_every_axis_has_a_unit():
    all_figures = [
        figures.slip_figure(label_estimates(driven()), driven(), EPOCH),
        figures.path_figure(label_estimates(driven()), driven()),
        figures.friction_figure(label_estimates(driven()), driven(), EPOCH),
        figures.waveform_figure(
            figures.crossing_waveform(driven().crossings[0], measured(), ROBOT))]
    for figure in all_figures:
        for ax in figure.axes:
            assert all(text.endswith(']') and '[' in text for text in texts(ax)), texts(ax)


def test_each_interval_has_a_slip_panel():
    intervals = {name: [(ns(start), ns(start + 1.0))] for name, start in
                 (('concrete', 0.0), ('sand', 1.0), ('sand again', 2.0))}
    figure = figures.slip_figure(label_estimates(driven()), driven(), EPOCH, intervals)
    assert [ax.get_title() for ax in figure.axes] == ['concrete', 'sand', 'sand again']
    assert [ax.get_xlim() for ax in figure.axes] == [(0.0, 1.0), (1.0, 2.0), (2.0, 3.0)]


def test_the_slip_axis_is_that_of_the_intervals():
    spinning = driven()
    for k in range(100):
        spinning.add(WheelSlip(ns(4.0 + 0.01 * k), (0.9,) * 4, (0.0,) * 4, (0.02,) * 4))
    labeled, intervals = label_estimates(spinning), {'concrete': [(ns(0.0), ns(1.0))]}
    high = {name: figures.slip_figure(labeled, Series(), EPOCH, chosen).axes[0].get_ylim()[1]
            for name, chosen in (('all', None), ('interval', intervals))}
    assert high['all'] > 0.9 and high['interval'] < 0.3


def test_filtered_and_smoothed_estimates_are_both_drawn():
    labeled, truth = label_estimates(driven(), driven()), driven()
    slip, friction = (draw(labeled, truth, EPOCH)
                      for draw in (figures.slip_figure, figures.friction_figure))
    assert [ax.get_title() for ax in slip.axes] == ['filtered', 'smoothed']
    assert [ax.get_title() for ax in friction.axes] == [
        'front left, filtered', 'front left, smoothed']
    path, *errors = figures.path_figure(labeled, truth).axes
    assert [line.get_label() for line in path.lines] == ['filtered', 'smoothed', 'truth', 'start']
    for ax in errors:
        colors = [line.get_color() for line in ax.lines]
        assert len(set(colors)) == len(colors) == 2


@pytest.mark.parametrize('truth', [Series(), None])
def test_wanted_paths_are_drawn_once_in_the_legend(truth):
    wanted = [np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([[1.0, 0.0], [1.0, 1.0]])]
    ax = figures.path_figure(label_estimates(driven()), driven() if truth is None else truth,
                             wanted).axes[0]
    labels = ax.get_legend_handles_labels()[1]
    assert labels[0] == 'wanted' and labels.count('wanted') == 1
    assert [line.get_xydata().tolist() for line in ax.lines[:2]] == [
        path.tolist() for path in wanted]


def test_ground_truth_is_drawn_if_available():
    with_truth, without = (figures.slip_figure(label_estimates(driven()), truth, EPOCH).axes[0]
                           for truth in (driven(), Series()))
    assert len(with_truth.lines) == 4 and len(without.lines) == 2


def test_a_single_spike_does_not_change_the_slip_axis():
    spiky = driven()
    spiky.add(WheelSlip(ns(4.0), (1.0,) * 4, (0.0,) * 4, (0.02,) * 4))
    low, high = figures.slip_figure(label_estimates(spiky), Series(), EPOCH).axes[0].get_ylim()
    assert -0.3 < low < -0.1 and 0.1 < high < 0.3


def test_undefined_slip_has_valid_axis_limits():
    standing = Series()
    for i in range(10):
        standing.add(WheelSlip(ns(i), (math.nan,) * 4, (0.0,) * 4, (1.0,) * 4))
    low, high = figures.slip_figure(label_estimates(standing), Series(), EPOCH).axes[0].get_ylim()
    assert low < 0.0 < high


def test_an_uninformative_single_estimate_is_not_drawn():
    curve = friction_curve('front_left', driven(), Series(), EPOCH)
    assert np.isnan(curve.single.value).tolist() == [False, True, False]
    assert curve.single.time_s.tolist() == [1.0, 2.0, 3.0]


def test_the_crossing_shown_is_one_in_traction_with_median_slip():
    crossings = driven().crossings
    crossings.append(Friction(ns(3.5), 'front_left', slip=Uncertain(-0.12, 0.0)))
    assert figures.typical_crossings(crossings)[0].slip.value == 0.12


def test_without_traction_any_crossing_of_known_slip_is_shown():
    crossings = [Friction(ns(1.0), 'front_left', slip=slip)
                 for slip in (UNKNOWN, Uncertain(-0.1, 0.0))]
    assert [p.slip.value for p in figures.typical_crossings(crossings)] == [-0.1]
    assert figures.typical_crossings([]) == []


def test_the_waveform_covers_the_crossing_and_the_time_of_each_film_in_the_patch():
    waveform = figures.crossing_waveform(driven().crossings[0], measured(), ROBOT)
    speed = ROBOT.wheel_radius * OMEGA
    first, second = waveform.inside_ms
    assert first[1] - first[0] == pytest.approx(1e3 * 0.066 / speed)  # patch and film
    assert second[0] - first[0] == pytest.approx(1e3 * 0.030 / speed)  # spacing of the films
    assert first[0] + second[1] == pytest.approx(0.0)
    assert waveform.time_ms[0] < first[0] and second[1] < waveform.time_ms[-1]


def test_in_reverse_film_two_enters_first():
    inputs = Series()
    for i in range(1600):
        inputs.add(TireSample(ns(i / 400), 'front_left', (1.65, 1.65)))
    for i in range(64):
        inputs.add(WheelSample(ns(i / 16), (-OMEGA,) * 4))
    first, second = figures.crossing_waveform(driven().crossings[0], inputs, ROBOT).inside_ms
    assert second[0] < first[0]


def test_a_crossing_with_a_lost_batch_is_not_shown():
    assert figures.crossing_waveform(driven().crossings[0], measured((0.98, 1.02)), ROBOT) is None


@pytest.mark.parametrize('inputs', [Series(), measured()])
def test_a_waveform_needs_samples_and_speed_of_its_wheel(inputs):
    elsewhere = Friction(ns(1.0), 'rear_left', slip=Uncertain(0.1, 0.0))
    assert figures.crossing_waveform(elsewhere, inputs, ROBOT) is None


def long_drive(duration=120.0):
    """Return slips of a drive with a standstill, and wheel speeds that change at 20 and 90 s."""
    estimates, inputs = Series(), Series()
    for i in range(round(10 * duration)):
        time = 0.1 * i
        standing, sigma = 40.0 <= time < 60.0, 1.0 if 60.0 <= time < 61.0 else 0.02
        ratio = math.nan if standing else -1.0 if sigma == 1.0 else 0.1
        estimates.add(WheelSlip(ns(time), (ratio,) * 4, (0.0,) * 4, (sigma,) * 4))
        turning = 20.0 <= time < 25.0 or 90.0 <= time < 95.0
        inputs.add(WheelSample(ns(time), (OMEGA + (i % 2 if turning else 0.0),) * 4))
    estimates.crossings = [Friction(
        ns(time), 'front_left', friction_coefficient=Uncertain(0.5, 0.03),
        friction_coefficient_single=Uncertain(value, sigma), slip=Uncertain(0.1, 0.0))
        for time, value, sigma in ((20.0, 0.5, 0.05), (21.0, 2.0, 0.05), (22.0, 0.5, 0.9),
                                   (91.0, 0.5, 0.05))]
    return estimates, inputs


def drawn_parts(line):
    """Return the number of pieces into which NaN values divide a line."""
    known = np.isfinite(line.get_ydata())
    return int(known[0]) + int((np.diff(known.astype(int)) == 1).sum())


def test_long_recordings_have_an_overview_and_segments():
    estimates, inputs = long_drive()
    parts = figures.busiest_segments(inputs, EPOCH)
    assert len(parts) == 2
    labeled = label_estimates(estimates)
    for figure in (figures.slip_figure(labeled, Series(), EPOCH, segments=parts),
                   figures.friction_figure(labeled, Series(), EPOCH, segments=parts)):
        overview, first, second = figure.axes
        assert [text.get_text() for text in overview.texts] == ['A', 'B']
        assert [first.get_xlim(), second.get_xlim()] == parts
        assert first.get_title().startswith('A: ') and second.get_title().startswith('B: ')
        assert first.get_ylim() == overview.get_ylim()
    assert not overview.containers[0].has_yerr  # friction: the bars of many crossings overlap
    assert first.containers[0].has_yerr


def test_intervals_replace_segments_and_short_recordings_have_none():
    estimates, inputs = long_drive()
    figure = figures.slip_figure(label_estimates(estimates), Series(), EPOCH,
                                 {'all': [(ns(0.0), ns(100.0))]}, [(20.0, 35.0)])
    assert [ax.get_title() for ax in figure.axes] == ['all']
    assert figures.busiest_segments(long_drive(59.0)[1], EPOCH) == []
    assert figures.busiest_segments(Series(), EPOCH) == []


def test_slip_has_no_line_at_standstill_and_where_it_is_unknown():
    estimates, _ = long_drive()
    figure = figures.slip_figure(label_estimates(estimates), Series(), EPOCH)
    line = figure.axes[0].lines[0]
    assert np.nanmin(line.get_ydata()) == pytest.approx(0.1)
    assert drawn_parts(line) == 2
    low, high = figure.axes[0].get_ylim()
    assert (low, high) == pytest.approx((0.0, 0.2))
    assert '(1.0 % of the values)' in caption_of(figure)


def caption_of(figure):
    return figure.get_supxlabel().replace('\n', ' ')


def test_the_caption_of_friction_counts_what_is_not_shown():
    figure = figures.friction_figure(label_estimates(long_drive()[0]), Series(), EPOCH)
    text = caption_of(figure)
    assert '1 of 4 single crossings' in text and '33.3 % of the others are outside' in text
    assert 'Dashed' not in text
    assert drawn_parts(figure.axes[0].lines[1]) == 2  # between 22 and 91 s


def test_every_figure_says_what_its_bands_mean_and_its_legend_covers_no_data():
    labeled, truth = label_estimates(driven()), driven()
    for figure in (figures.slip_figure(labeled, truth, EPOCH), figures.path_figure(labeled, truth),
                   figures.friction_figure(labeled, truth, EPOCH)):
        assert 'σ is the standard deviation that the estimator reports' in caption_of(figure)
        assert len(figure.legends) == 1
        assert all(ax.get_legend() is None for ax in figure.axes)
