# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Figures as data: gaps, unknown slip, axis limits, segments; and their panels by matplotlib."""

import math

from matplotlib.backends.backend_agg import FigureCanvasAgg
import numpy as np
import pytest

from smart_tire.analysis.drawing import render
from smart_tire.analysis.figure import (
    Curve, Figure, interrupted, limits, Mark, MAX_SLIP_SIGMA, observable, outside_caption, Panel,
    runs, segments, share_outside, truth_marks)

LINE = Curve(np.arange(3.0), np.array([1.0, 2.0, math.nan]), np.array([0.1, 0.2, 0.3]))


def test_a_line_is_interrupted_in_gaps_only():
    curve = Curve(np.array([0.0, 0.5, 1.01, 1.2]), np.arange(4.0), np.ones(4))
    drawn = interrupted(curve)
    assert np.isnan(drawn.y).tolist() == [False, False, True, False, False]
    assert np.isnan(drawn.sigma).tolist() == [False, False, True, False, False]
    assert 0.5 < drawn.x[2] < 1.01
    assert not np.isnan(interrupted(curve, max_gap=0.52).y).any()


def test_slip_with_a_large_standard_deviation_is_removed_and_counted():
    sigma = np.array([0.1, MAX_SLIP_SIGMA, 0.51, math.nan, 1.0])
    curve, share = observable(Curve(np.arange(5.0), np.array([0.1, 0.2, 1.0, 1.0, math.nan]),
                                    sigma))
    assert np.isnan(curve.y).tolist() == [False, False, True, True, True]
    assert share == 0.5  # of four finite values
    assert observable(Curve(np.arange(2.0), np.array([1.0, -1.0])))[1] == 0.0
    assert observable(Curve(np.arange(1.0), np.array([math.nan]), np.ones(1)))[1] == 0.0


def test_limits_ignore_a_few_extreme_values_and_count_them():
    values = np.append(np.linspace(0.0, 1.0, 999), 50.0)
    low, high = limits([values, np.array([math.nan])], 0.1)
    assert -0.25 < low < -0.15 and 1.15 < high < 1.25
    assert share_outside([values], low, high) == pytest.approx(0.001)
    assert share_outside([np.array([math.nan])], low, high) == 0.0
    assert outside_caption([values], low, high) == (
        ' 0.1 % of the others are outside of the axes.')
    assert outside_caption([values], -2.0 * abs(low), 1e9) == ''


@pytest.mark.parametrize('values', [[], [np.full(3, math.nan)], [np.full(3, 0.0)]])
def test_limits_of_nothing_have_the_smallest_margin(values):
    assert limits(values, 0.1) == (-0.1, 0.1)


def test_runs_are_the_intervals_of_known_rows():
    assert list(runs(np.array([True, False, True, True]))) == [slice(0, 1), slice(2, 4)]
    assert list(runs(np.zeros(2, bool))) == []


def active(*times, duration=300.0):
    """Return a curve that changes for 5 s after each of ``times``."""
    time = np.arange(0.0, duration, 0.05)
    value = sum(np.sin(3.0 * time) * ((time > start) & (time < start + 5.0)) for start in times)
    return Curve(time, value)


def test_segments_are_where_the_curve_changes_in_order_of_time_and_do_not_overlap():
    found = segments([active(200.0, 40.0, 120.0)])
    assert len(found) == 3
    for (begin, end), start in zip(found, (40.0, 120.0, 200.0)):
        assert begin <= start + 0.2 and end >= start + 4.8
        assert end - begin == pytest.approx(15.0)
    found = segments([active(100.0, 104.0, 108.0)])
    assert 1 <= len(found) <= 3
    assert all(first[1] <= second[0] for first, second in zip(found, found[1:]))
    for nothing in ([Curve(np.arange(100.0), np.zeros(100))], [active(10.0, duration=59.0)], [],
                    [Curve(np.zeros(1), np.zeros(1))]):
        assert segments(nothing) == []


def panel(*marks, **options):
    return Panel(marks, 'time [s]', 'value [m]', 'A title', **options)


def drawn(rows, **options):
    return render(Figure('name', 'what is shown', 'A caption. ' * 20, rows, **options))


def test_a_panel_has_bands_bars_labels_and_one_legend_that_covers_no_data():
    line, points = Mark(LINE, 'estimate'), Mark(LINE, 'single', kind='points')
    figure = drawn([[panel(line, points, *truth_marks(LINE))], [panel(line)]])
    first = figure.axes[0]
    assert (first.get_xlabel(), first.get_ylabel(), first.get_title()) == (
        '', 'value [m]', 'A title')  # the label of x is below the last row only
    assert figure.axes[1].get_xlabel() == 'time [s]'
    band = first.collections[0].get_datalim(first.transData)
    assert (band.y0, band.y1) == pytest.approx((0.8, 2.4))
    assert first.containers[0].has_yerr
    [legend] = figure.legends
    assert sorted(text.get_text() for text in legend.texts) == ['estimate', 'single', 'truth']
    assert all(ax.get_legend() is None for ax in figure.axes)
    assert 'A caption. A caption.' in figure.get_supxlabel().replace('\n', ' ')


def test_the_band_of_an_error_is_around_zero():
    ax = drawn([[panel(Mark(LINE, around_zero=True))]]).axes[0]
    band = ax.collections[0].get_datalim(ax.transData)
    assert (band.y0, band.y1) == pytest.approx((-0.4, 0.4))


def test_a_panel_spans_its_cells_and_none_is_empty():
    wide, left = panel(Mark(LINE)), panel(Mark(LINE))
    figure = drawn([[wide, wide], [left, None]])
    assert len(figure.axes) == 2
    assert figure.axes[0].get_subplotspec().colspan == range(0, 2)


def test_segments_are_drawn_below_an_overview_without_bars():
    mark = Mark(LINE, 'single', kind='points')
    figure = drawn([[panel(mark, y_limits=(0.0, 3.0))]], segments=[(0.0, 1.0), (1.5, 2.0)])
    overview, first, second = figure.axes
    assert [text.get_text() for text in overview.texts] == ['A', 'B']
    assert [first.get_xlim(), second.get_xlim()] == [(0.0, 1.0), (1.5, 2.0)]
    assert second.get_title() == 'A title, B: 2 s to 2 s' and first.get_ylim() == (0.0, 3.0)
    assert first.containers[0].has_yerr and not overview.containers[0].has_yerr


@pytest.mark.parametrize('size', [(0.5, 20.0), (20.0, 0.5), (3.0, 3.0)])
@pytest.mark.parametrize('rows', [1, 2])
def test_a_path_is_shown_whole(size, rows):
    ends = Curve(*(np.array([0.0, one]) for one in size))
    path = panel(Mark(ends), equal=True)
    figure = drawn([[path, panel(Mark(LINE))] * (rows > 1) or [path]] * rows)
    FigureCanvasAgg(figure).draw()
    ax, (x, y) = figure.axes[0], size
    assert ax.get_xlim()[0] < 0.0 < x < ax.get_xlim()[1]
    assert ax.get_ylim()[0] < 0.0 < y < ax.get_ylim()[1]


def test_an_area_is_drawn_per_run_of_corners_and_does_not_change_the_limits():
    corners = Curve(np.array([0.0, 9.0, 9.0, math.nan, 0.0, 1.0, 1.0]),
                    np.array([0.0, 0.0, 9.0, math.nan, 0.0, 0.0, 1.0]))
    line = Mark(Curve(np.zeros(2), np.ones(2)))
    plain, shaded = (drawn([[panel(*marks, equal=True)]]).axes[0] for marks in (
        [line], [line, Mark(corners, 'ground', kind='area')]))
    assert len(shaded.artists) + len(shaded.patches) == 2
    assert plain.get_xlim() == shaded.get_xlim() and plain.get_ylim() == shaded.get_ylim()
    assert shaded.get_legend_handles_labels()[1] == ['ground']


def test_each_panel_may_have_its_own_legend_with_its_title():
    figure = drawn([[panel(Mark(LINE, 'a')), panel(Mark(LINE, 'b'))]], panel_legends=True)
    assert not figure.legends
    assert [ax.get_legend().get_title().get_text() for ax in figure.axes] == ['A title'] * 2
