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

"""Friction, stiffness and motion of a short run, without and with torque."""

from __future__ import annotations

from dataclasses import replace
import math

from benchmarks.friction import force_tables, forces
from benchmarks.friction.force_figures import force_figure
from benchmarks.friction.force_results import (
    ALL_GROUNDS, consistency, EXCITED_SUFFIX, pooled, Row, rows_of)
from benchmarks.friction.force_tables import friction_table, motion_table, stiffness_table
from benchmarks.friction.forces import NO_TORQUE, run_forces, TORQUE, VARIANTS
from benchmarks.friction.ground_scenarios import GROUND_SCENARIOS
from benchmarks.friction.previous_results import PREVIOUS_RESULTS
from benchmarks.friction.reference_results import FORCE_REFERENCES
from benchmarks.friction.requirements import Limits, limits_of, REQUIREMENTS
from benchmarks.friction.run import SCENARIOS, TITLES
from benchmarks.grounds import CONCRETE, ground, SAND
import numpy as np
import pytest
from rich.console import Console
from smart_tire.samples import WheelSample

SHORT_TOUR = replace(
    GROUND_SCENARIOS['tour'], duration=15.0, ground=ground(CONCRETE, fields=[(SAND, 3.0, 90.0)]))
GROUNDS = {'tour': SHORT_TOUR.ground}


@pytest.fixture(scope='module')
def result():
    """Return the results of the start of the tour, with sand after 3 m."""
    return run_forces('tour', 1, SHORT_TOUR.events(1), SHORT_TOUR.robot)


def text_of(table):
    console = Console(width=160)
    with console.capture() as capture:
        console.print(table)
    return capture.get()


def test_both_variants_score_all_film_wheels(result):
    assert result.variants.keys() == VARIANTS.keys()
    for variant in result.variants.values():
        assert variant.wheels.keys() == set(SHORT_TOUR.film.wheels)
        assert variant.speedup > 1.0
        for part in variant.wheels.values():
            assert part.rows.found.all()
            assert 0 < part.counted.sum() < len(part.counted)
            assert len(part.surfaces) == 2


def test_only_the_variant_with_torque_receives_efforts(monkeypatch):
    seen = []

    class Pipeline:

        def __init__(self, params):
            seen.append(set())

        def update(self, sample):
            if isinstance(sample, WheelSample):
                seen[-1].add(sample.effort is not None)
            return []

        def finish(self):
            return []
    monkeypatch.setattr(forces, 'Pipeline', Pipeline)
    monkeypatch.setattr(forces, '_motion', lambda *_: None)
    start = replace(SHORT_TOUR, duration=4.0)
    run_forces('tour', 1, start.events(1), start.robot)
    assert seen == [{False}, {True}]


def test_a_run_on_two_grounds_has_three_rows(result):
    rows = rows_of([result, replace(result, seed=2)], GROUNDS)
    assert list(rows) == [('tour', ALL_GROUNDS), ('tour', CONCRETE), ('tour', SAND)]
    counts = [row.variants[TORQUE]['crossings'] for row in rows.values()]
    assert counts[0] == counts[1] + counts[2] > counts[2] > 0
    one_seed = rows_of([result], GROUNDS)['tour', ALL_GROUNDS].variants[TORQUE]
    assert counts[0] == 2.0 * one_seed['crossings']


def test_crossings_after_excitation_are_scored_separately(result):
    own = rows_of([result], GROUNDS)['tour', SAND].variants[NO_TORQUE]
    assert own[f'crossings{EXCITED_SUFFIX}'] <= own['crossings']


def test_the_lateral_speed_and_the_slips_have_plausible_errors(result):
    own = rows_of([result], GROUNDS)['tour', ALL_GROUNDS].variants[NO_TORQUE]
    assert 0.0 < own['speed_y'] < 0.03
    assert own['slip_left'] > 0.0 and 0.0 < own['slip_left_all_times'] < 0.2
    assert math.isnan(own['common_slip'])  # nothing but turns


@pytest.mark.xfail(reason='0.11: without torques sand is found 2 s after its begin, of 6 s on it')
def test_slips_over_a_change_of_ground_without_torques(result):
    assert rows_of([result], GROUNDS)['tour', ALL_GROUNDS].variants[NO_TORQUE]['slip_left'] < 0.05


def test_consistency_ignores_crossings_without_a_sigma():
    error, sigma = np.array([0.1, -0.3, math.nan, 0.5]), np.array([0.1, 0.1, 0.1, math.inf])
    found = consistency('mu', error, sigma)
    assert found['mu_finite'] == 0.5
    assert found['mu_median'] == pytest.approx(0.2)
    assert found['mu_within'] == 0.5
    assert found['mu_nees'] == pytest.approx((1.0 + 9.0) / 2.0)
    assert math.isnan(consistency('mu', error[2:], sigma[2:])['mu_median'])


def test_all_runs_are_pooled_by_crossings(result):
    once, twice = pooled([result], TORQUE), pooled([result, result], TORQUE)
    assert twice['crossings'] == 2.0 * once['crossings']
    assert twice['mu_nees'] == pytest.approx(once['mu_nees'])


def test_the_tables_have_a_line_per_ground_and_are_not_truncated(result):
    rows = rows_of([result], GROUNDS)
    for table in force_tables.force_tables(rows, [result], TITLES):
        text = text_of(table)
        assert TITLES['tour'] in text and '…' not in text
    text = text_of(friction_table(rows, [result], TITLES))
    assert all(name in text for name in ('concrete', 'sand', 'all'))


def test_mu_and_stiffness_are_drawn_with_truth_for_each_wheel(result):
    figure = force_figure('tour', result)
    assert len(figure.axes) == 4
    assert {ax.get_ylabel() for ax in figure.axes} - {''} == {'μ [-]', '$C_x$ [N]'}
    for ax in figure.axes:
        assert len(ax.collections) == len(VARIANTS)
        assert [line.get_label() for line in ax.lines].count('truth') == 1


def table_of(build, limits, monkeypatch, **figures):
    """Return the marks in a table of one run with ``figures`` and ``limits``."""
    own = dict.fromkeys((
        f'{name}_{kind}{suffix}' for name in ('mu', 'stiffness')
        for kind in ('median', '90', 'bias', 'within', 'nees', 'finite')
        for suffix in ('', EXCITED_SUFFIX)), 1.0)
    own |= dict.fromkeys(('crossings', 'sliding_bias', 'speed_y', 'common_slip', 'jump_worst',
                          'jump_revolutions'), 1.0) | figures
    monkeypatch.setattr(force_tables, 'limits_of', lambda *_: limits)
    rows = {('tour', ''): Row('tour', '', {NO_TORQUE: own, TORQUE: own})}
    arguments = (rows, TITLES) if build is motion_table else (rows, [], TITLES)
    monkeypatch.setattr(force_tables, '_pooled', lambda *_: ['', ''])
    return text_of(build(*arguments)).count('!')


@pytest.mark.parametrize(('build', 'limits', 'figures', 'marks'), [
    (friction_table, Limits(), {}, 0),
    (friction_table, Limits(), {'mu_within': 0.87}, 2),
    (friction_table, Limits(mu_median=0.5), {}, 2),
    (friction_table, Limits(mu_90=0.5), {'mu_90': 0.4}, 1),  # without torque only after 5 s
    (friction_table, Limits(sliding=0.5), {'sliding_bias': -0.6}, 1),
    (stiffness_table, Limits(stiffness=0.5), {}, 2),
    (stiffness_table, Limits(), {'stiffness_within': 0.5}, 2),
    (motion_table, Limits(speed_y=0.5), {}, 2),
    (motion_table, Limits(common_slip=0.005), {'common_slip': 0.0054}, 0),
    (motion_table, Limits(jump_revolutions=3.0), {'jump_worst': 4.0}, 2)])
def test_figures_outside_the_requirements_are_marked(build, limits, figures, marks, monkeypatch):
    assert table_of(build, limits, monkeypatch, **figures) == marks


def test_requirements_references_and_previous_results_belong_to_existing_rows():
    for run, name in (*REQUIREMENTS, *FORCE_REFERENCES, *PREVIOUS_RESULTS):
        assert run in SCENARIOS
        assert name in ('', *SCENARIOS[run].ground.names)
    assert {run for run, name in PREVIOUS_RESULTS if not name} == SCENARIOS.keys()


def test_grounds_other_than_sand_have_the_tight_limits_with_torque():
    assert limits_of('tour', CONCRETE, TORQUE).mu_median == 0.05
    assert limits_of('tour', SAND, TORQUE).stiffness == 0.10
    assert limits_of('tour', SAND, NO_TORQUE).mu_90 == 0.25
    assert limits_of('torque_constant', ALL_GROUNDS, TORQUE) == Limits()
