# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Figures of paper B: properties of the results of plant, films and estimators."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from smart_tire.papers import paper_b, tire_maps, tire_runs
from smart_tire.papers.tire_maps import MU, STIFFNESS
from smart_tire.simulation.offline import simulate
from smart_tire.uncertain import Uncertain
from support.identifying import assert_consistent

pytestmark = pytest.mark.slow

DURATION = 12.0  # s
SPEEDS = (40.0, 60.0), (20.0, 60.0), (100.0, 60.0), (20.0, 80.0), (40.0, 80.0)  # rpm

complete = pytest.mark.parametrize('sweep', [pytest.param(SPEEDS, marks=pytest.mark.long)],
                                   indirect=True)


@pytest.fixture(scope='module')
def slip_runs():
    return {ground: tire_runs.drive(ground, tire_runs.steady(120.0, 60.0), DURATION)
            for ground in ('concrete', 'sand')}


@pytest.fixture(scope='module')
def slips(slip_runs):
    return {ground: tire_runs.side_slips(run, run.estimates) for ground, run in slip_runs.items()}


@pytest.fixture(scope='module')
def printed(slip_runs):
    return {ground: tire_runs.side_slips(run, run.printed) for ground, run in slip_runs.items()}


@pytest.fixture(scope='module')
def turning():
    return tire_runs.drive('concrete', tire_runs.steady(60.0, 80.0), DURATION)


@pytest.fixture(scope='module', params=[SPEEDS[:1]])
def sweep(request, turning):
    parts = [tire_runs.crossings(turning, 80.0)]
    for left, right in request.param:
        run = tire_runs.drive('concrete', tire_runs.steady(left, right), DURATION)
        parts.append(tire_runs.crossings(run, right))
    return tire_maps.sweep(tire_runs.concatenated(parts))


def test_the_printed_interval_is_longer_than_the_exact_one():
    found = tire_maps.outline()
    assert found.interval < found.printed_interval < found.whole
    # from the maximum of the drawn curve to its minimum
    volts = found.bending['fig8'] + found.stretch
    between = found.time[volts.argmin()] - found.time[volts.argmax()]
    assert between == pytest.approx(found.interval, abs=1e-4)


def test_q_sm_is_the_difference_of_two_peaks_only_for_the_drawn_release():
    found = tire_maps.outline()
    assert found.read_height('fig8') == pytest.approx(found.height, rel=1e-4)
    assert found.read_height('state') == pytest.approx(found.height + tire_maps.BENDING, rel=1e-4)


def test_the_printed_charge_is_too_low():
    slip = np.array([0.1, 0.3])
    low = 1.0 - tire_maps.printed_stretch(slip) / tire_maps.exact_stretch(slip)
    np.testing.assert_allclose(low, [0.05, 0.25], atol=0.01)


def test_the_printed_map_overestimates_friction_without_any_noise():
    slip = np.linspace(0.01, 0.3, 30)
    excess = tire_maps.printed_excess(slip)
    assert np.all(np.diff(excess) > 0.0)
    assert excess[0] == pytest.approx(1.0 / (1.0 - 20.0 / 46.0), rel=0.02)  # 1 / (1 - l / L)
    assert excess[-1] == pytest.approx(2.17, abs=0.02)


def test_slips_have_the_signs_of_the_paper_and_agree_with_the_truth(slips):
    assert min(slips['sand'][side].true_mean for side in ('left', 'right')) > 0.0
    assert slips['concrete']['left'].true_mean > 0.0 > slips['concrete']['right'].true_mean
    for sides in slips.values():
        for score in sides.values():
            assert score.error.rms < 0.03


@pytest.fixture(scope='module')
def views(slip_runs):
    return {ground: tire_runs.camera_view(run, 5.0) for ground, run in slip_runs.items()}


def test_the_rendered_camera_sees_the_path_and_the_slip_of_the_truth(
        slip_runs, views, slips, printed):
    for ground, view in views.items():
        assert view.found.published == view.found.images == 50
        for score in tire_runs.side_slips(slip_runs[ground], view.estimates).values():
            assert score.error.count > 100 and score.error.rms < 0.006
            assert score.error.within_two > 0.9
    found = paper_b.view_section(views['concrete'], slip_runs['concrete'])
    assert len(found.agrees) == 2 and found.figure.panels[0].image is not None
    figure = paper_b.slip_section(slip_runs, views, slips, printed).figure
    for panel in figure.panels:
        labels = [mark.label for mark in panel.marks]
        assert labels[:2] == ['left side ± 2σ', 'right side ± 2σ']
        assert labels.count('camera ± 2σ') == labels.count('truth') == 2


def test_the_delay_between_films_agrees_with_their_distance(turning):
    found = tire_maps.signals(turning)
    period = 1.0 / 400.0  # s; a revolution of 0.75 s is 300 samples: the mean does not reduce it
    assert found.lag == pytest.approx(found.expected_lag, abs=period)
    assert np.all(found.variation > 0.05) and np.all(found.variation < 0.35)
    assert 0.05 < found.bump < 0.2


def test_fitted_stretch_charges_are_correct_and_raw_ones_too_large(sweep):
    crossings = sweep.crossings
    sliding = crossings.true_total_slip > tire_maps.MIN_SLIP
    ratio = (crossings.stretch / crossings.true_stretch)[sliding]
    assert np.nanmedian(ratio) == pytest.approx(1.0, abs=0.03)
    assert np.nanmean(crossings.raw_stretch - crossings.stretch) > 0.03


@complete
def test_both_wheel_speeds_give_the_same_line(sweep):
    slow, fast = sweep.lines[60.0], sweep.lines[80.0]
    assert min(slow.determination, fast.determination) > 0.95
    assert fast.slope == pytest.approx(slow.slope, rel=0.1)


@complete
def test_the_exact_map_agrees_with_the_model_and_the_printed_one_is_half_as_steep(sweep):
    assert sweep.slopes['exact'].slope * tire_maps.CRITICAL == pytest.approx(-1.0, abs=0.15)
    assert -0.6 < sweep.slopes['printed'].slope * tire_maps.CRITICAL < -0.35
    assert sweep.slopes['paper'].determination < sweep.slopes['printed'].determination


def test_friction_is_correct_with_the_exact_map_and_doubled_by_the_printed_one(sweep):
    exact, printed = (float(np.nanmedian(sweep.friction[method]))
                      for method in ('exact', 'printed'))
    assert exact == pytest.approx(MU, rel=0.1)
    assert 1.6 < printed / MU < 2.2


@complete
def test_braking_crossings_are_counted_and_not_used(sweep):
    assert len(sweep.braking) > 5 and np.isnan(sweep.braking.stretch).all()
    assert (sweep.crossings.slip > 0.0).all()


def without_films(params, schedule, duration):
    """Return the events of a drive from which only the slips can be estimated."""
    return [event for event in simulate(params, schedule, duration, torque=False)
            if event[1] != 'tire_samples']


@pytest.mark.parametrize('seeds', [1, pytest.param(6, marks=pytest.mark.long)])
def test_the_stiffness_from_accelerations_is_correct_within_its_standard_error(
        monkeypatch, seeds):
    monkeypatch.setattr(tire_runs, 'simulate', without_films)  # it needs no estimates
    found = []
    for seed in range(1, seeds + 1):
        run = tire_runs.drive('concrete', tire_runs.oscillating, DURATION, seed)
        fit = tire_runs.stiffness(run, MU)
        found.append(Uncertain(fit.stiffness, fit.sigma))
        assert fit.sigma < 0.01 * STIFFNESS
        # forces result from the speed over ground at the start of a step of the simulation
        assert 0.0 < fit.lag < 0.002
    assert_consistent(found, STIFFNESS, 0.5, 1.6)


def test_the_printed_constraint_shows_the_same_slip_difference(slips, printed):
    for ground, sides in slips.items():
        for side, score in sides.items():
            assert printed[ground][side].estimated_mean == pytest.approx(
                score.true_mean, abs=0.05)
            assert printed[ground][side].estimated_mean != score.estimated_mean


def test_statements_depend_on_the_numbers(slip_runs, views, slips, printed, sweep):
    section = paper_b.slip_section(slip_runs, views, slips, printed)
    assert any('both sides have positive slip' in text for text in section.agrees)
    concrete = slips['concrete']
    section = paper_b.slip_section(
        slip_runs, views, {'sand': concrete, 'concrete': concrete}, printed)
    assert any('at least one side' in text for text in section.differs)
    steep = {**sweep.slopes, 'exact': replace(sweep.slopes['exact'], slope=-3.0)}
    section = paper_b.adhesion_section(replace(sweep, slopes=steep))
    assert any('does not agree' in text for text in section.differs)
