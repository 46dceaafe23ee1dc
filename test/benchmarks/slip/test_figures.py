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

"""Figures of the slip benchmark: curves, labels and axis limits."""

from __future__ import annotations

from dataclasses import replace

from benchmarks.scenarios import SCENARIOS
from benchmarks.slip.comparison import compare_methods, METHODS
from benchmarks.slip.figures import path_figure, save, slip_figure
from benchmarks.slip.series import as_truth
import numpy as np
import pytest
from smart_tire.analysis.metrics import aligned
from smart_tire.parameters import SlipEstimatorParams


def ran(name, duration):
    """Return estimates and ground truth of the start of a scenario."""
    scenario = replace(SCENARIOS[name], duration=duration)
    events = scenario.events(1)
    truth = as_truth((sample for _, topic, sample in events if 'truth' in topic), scenario.robot)
    samples = [sample for _, topic, sample in events if 'truth' not in topic]
    return compare_methods(samples, SlipEstimatorParams(robot=scenario.robot), truth.poses), truth


@pytest.fixture(scope='module')
def turning():
    """Return a short turn."""
    return ran('concrete', 8.0)


@pytest.fixture(scope='module')
def straight():
    """Return a short straight run."""
    return ran('straight', 6.0)


def panel(figure, label):
    """Return the axes whose y label contains ``label``; None if there are none."""
    return next((ax for ax in figure.axes if label in ax.get_ylabel()), None)


def test_slips_are_drawn_with_bands_truth_and_units(turning):
    figure = slip_figure('turn', *turning)
    for side in ('left', 'right'):
        ax = panel(figure, f'slip of the {side} side')
        assert '[-]' in ax.get_ylabel()
        assert len(ax.collections) == 2  # bands of live and smoothed
        assert [line.get_label() for line in ax.lines][-1] == 'truth'
        low, high = ax.get_ylim()
        true = ax.lines[-1].get_ydata()
        assert np.mean((true[np.isfinite(true)] > low) & (true[np.isfinite(true)] < high)) > 0.9


def test_the_icr_has_a_panel_only_if_the_robot_turns(turning, straight):
    assert panel(slip_figure('turn', *turning), 'ICR') is not None
    assert panel(slip_figure('straight', *straight), 'ICR') is None
    assert panel(slip_figure('straight', *straight), 'innovation') is not None


def test_the_path_shows_all_methods_in_the_frame_of_the_first(turning, tmp_path):
    estimates, truth = turning
    aligned_poses = {name: aligned(truth.poses, one.poses) for name, one in estimates.items()}
    figure = path_figure('turn', estimates, aligned_poses)
    ax = panel(figure, 'y [m]')
    labels = {line.get_label() for line in ax.lines}
    assert labels == {*METHODS.values(), 'truth', 'start'}
    starts = [line.get_xydata()[0] for line in ax.lines]
    assert np.ptp(starts, axis=0) == pytest.approx(0.0, abs=0.02)
    assert save(figure, tmp_path / 'new' / 'path.png').stat().st_size > 10_000


def test_a_diverged_method_does_not_set_the_axis_limits(turning):
    estimates, truth = turning
    aligned_poses = {name: aligned(truth.poses, one.poses) for name, one in estimates.items()}
    guess, true, stamps = aligned_poses['wheels']
    calm = path_figure('turn', estimates, aligned_poses)
    lost = path_figure('turn', estimates,
                       {**aligned_poses, 'wheels': (guess + 1000.0, true, stamps)})
    for label in ('position error', 'heading error'):
        assert panel(lost, label).get_ylim()[1] <= panel(calm, label).get_ylim()[1]
