# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Combination of tracks in the cells of a map."""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np
import pytest
from smart_tire.errors import ParameterError
from smart_tire.mapping import grid
from smart_tire.mapping.grid import friction_map
from smart_tire.mapping.track import FrictionTrack, SPACING
from smart_tire.samples import NS_PER_S

DAY_NS = 86_400 * NS_PER_S


def track(mu, *, length=2.0, y=0.05, sigma=0.04, common=0.0, position=1e-4, blocks=None, day=0,
          **names):
    """Return a straight track along x with the friction ``mu``, a number or one per row."""
    x = np.arange(0.5 * SPACING, length, SPACING)
    ones = np.ones(len(x))
    return FrictionTrack(
        day * DAY_NS + np.arange(len(x)) * NS_PER_S // 20, np.column_stack([x, y * ones]),
        np.outer(ones, [position ** 2, 0.0, position ** 2]), mu * ones, sigma * mu * ones,
        common * mu * ones, np.zeros(len(x), np.int64),
        np.zeros(len(x), np.int64) if blocks is None else blocks(x), **names)


def test_a_drive_counts_once_in_a_cell_however_often_its_error_is_repeated():
    once, many = track(0.4), track(0.4)
    many = FrictionTrack(*(np.concatenate([getattr(many, name)] * 3) for name in (
        'stamp_ns', 'position', 'covariance', 'friction', 'sigma', 'common', 'side', 'block')))
    for tracks in ([once], [many]):
        found = friction_map(tracks).raster
        np.testing.assert_allclose(found.friction, 0.4)
        np.testing.assert_allclose(found.sigma, 0.04 * 0.4, rtol=0.02)


def test_parts_of_a_drive_with_independent_errors_count_each():
    first = track(0.4)
    both = FrictionTrack(*(np.concatenate([getattr(first, name)] * 2) for name in (
        'stamp_ns', 'position', 'covariance', 'friction', 'sigma', 'common', 'side')),
        np.repeat([0, 1], len(first)))
    np.testing.assert_allclose(friction_map([both]).raster.sigma, 0.016 / math.sqrt(2.0),
                               rtol=0.02)


def test_what_drives_of_one_robot_share_is_a_floor_of_the_standard_deviation():
    common, count = 0.03, 25
    own = math.sqrt(0.04 ** 2 - common ** 2)
    same = [track(0.4, common=common, drive=str(i), day=i) for i in range(count)]
    different = [replace(one, robot=one.drive) for one in same]
    sigma = [float(friction_map(one).raster.sigma[0, 3]) / 0.4 for one in (same, different)]
    assert sigma == pytest.approx([math.hypot(own / 5.0, common), 0.04 / 5.0], rel=0.02)


def test_errors_of_cells_agree_with_their_standard_deviations():
    rng, found = np.random.default_rng(4), []
    for _ in range(60):
        tracks = [track(0.5 * math.exp(0.05 * rng.standard_normal()), sigma=0.05, robot=str(i),
                        day=i) for i in range(10)]
        raster = friction_map(tracks).raster
        found.append(((raster.friction - 0.5) / raster.sigma)[0, 5])
    assert 0.6 < np.mean(np.square(found)) < 1.5
    assert raster.sigma[0, 5] == pytest.approx(0.05 * 0.5 / math.sqrt(10.0), rel=0.1)


def test_a_ground_that_has_changed_keeps_its_older_friction_with_its_time():
    tracks = [track(0.45, day=0), track(0.46, day=1), track(0.1, day=2), track(0.11, day=3)]
    cells = friction_map(tracks[::-1]).cells  # in any order
    now = cells.current == 1
    assert now.sum() == (~now).sum() == 20
    assert set(cells.drives) == {2}
    np.testing.assert_allclose(cells.friction[now], 0.105, atol=0.002)
    np.testing.assert_allclose(cells.friction[~now], 0.455, atol=0.002)
    assert cells.stamp_ns[now].min() >= 3 * DAY_NS > cells.first_ns[now].max() >= 2 * DAY_NS
    assert cells.stamp_ns[~now].max() < 2 * DAY_NS


def test_an_error_that_is_common_to_all_drives_is_not_all_of_it():
    raster = friction_map([track(0.4, sigma=0.04, common=0.04)]).raster
    np.testing.assert_allclose(raster.sigma, 0.04 * 0.4, rtol=0.02)


@pytest.mark.parametrize(('before', 'after'), [(0.45, 0.3), (0.3, 0.45)])
def test_ground_may_become_slippery_or_better(before, after):
    cells = friction_map([track(before), track(after, day=1)]).cells
    assert cells.columns()['current'].sum() == 20 and len(cells) == 40
    np.testing.assert_allclose(cells.friction[cells.current == 1], after)
    assert 'stamp_ns' not in cells.columns() and len(cells.columns()) == 7
    near = friction_map([track(before), track(before * math.exp(
        math.copysign(0.16, after - before)), day=1)]).cells  # 2.8 sigma
    assert (near.current == 1).all() and set(near.drives) == {2}


def test_a_border_within_one_drive_is_no_change_over_time():
    def mu(x):
        return np.where(x < 1.03, 0.45, 0.2)

    x = np.arange(0.5 * SPACING, 2.0, SPACING)
    found = friction_map([track(mu(x), blocks=lambda x: (x > 1.03).astype(int))])
    assert (found.cells.current == 1).all()
    friction, sigma = found.raster.friction[0], found.raster.sigma[0]
    np.testing.assert_allclose(friction[:10], 0.45, atol=1e-3)
    np.testing.assert_allclose(friction[11:], 0.2, atol=1e-3)
    assert math.isnan(friction[10])  # of both grounds
    small = friction_map([track(np.where(x < 1.03, 0.45, 0.35), blocks=lambda x: (
        x > 1.03).astype(int))]).raster
    assert small.sigma[0, 10] > 2.0 * sigma[5]
    assert 0.35 < small.friction[0, 10] < 0.45


def test_an_uncertain_position_spreads_the_evidence_to_the_cells_around():
    sharp, blurred = (friction_map([track(0.4, position=position)]).raster
                      for position in (1e-4, 0.1))
    assert sharp.friction.shape == (1, 20)
    rows = blurred.friction.shape[0]
    assert rows in (5, 7)
    middle = blurred.sigma[:, 10]
    assert np.argmin(middle) == rows // 2 and np.nanmin(middle) > sharp.sigma[0, 10]
    assert middle[rows // 2 + 1] > 1.1 * middle[rows // 2]
    unknown = friction_map([track(0.4, position=0.1), track(0.4, position=2.0, y=5.0)]).raster
    assert unknown.friction.shape[0] == rows  # of which the place is not known well enough


def test_cells_without_evidence_are_unknown():
    raster = friction_map([track(0.4), track(0.4, y=0.45)]).raster
    assert raster.friction.shape == (5, 20)
    assert np.isnan(raster.friction[1:4]).all() and np.isnan(raster.sigma[1:4]).all()
    assert np.isfinite(raster.friction[[0, 4]]).all()
    assert raster.origin == (0.0, 0.0)


def test_negative_coordinates_are_in_cells_of_their_own():
    one = track(0.4)
    raster = friction_map([replace(one, position=one.position - [1.0, 0.3])]).raster
    assert raster.origin == pytest.approx((-1.0, -0.3))
    assert raster.friction.shape == (1, 20)


def test_drives_in_different_frames_are_refused():
    with pytest.raises(ParameterError, match='frames map and odom, expected one'):
        friction_map([track(0.4), track(0.4, frame='map')])


@pytest.mark.parametrize('tracks', [[], [track(0.4, length=0.001)]])
def test_without_friction_there_is_no_map(tracks):
    with pytest.raises(ParameterError, match='no friction'):
        friction_map(tracks)


def test_a_map_that_would_be_too_large_is_refused(monkeypatch):
    monkeypatch.setattr(grid, 'MAX_CELLS', 19)
    with pytest.raises(ParameterError, match='20 x 1 cells of 0.1 m, expected at most 19'):
        friction_map([track(0.4)])


def test_tracks_survive_a_table_of_several_drives():
    tracks = [track(0.4, drive='a', robot='r'), track(0.3, drive='b', robot='s')]
    tables = [one.columns() for one in tracks]
    joined = {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
    found = list(FrictionTrack.of_columns(np.concatenate([t.stamp_ns for t in tracks]), joined))
    for one, other in zip(tracks, found, strict=True):
        assert (one.drive, one.robot, one.frame) == (other.drive, other.robot, other.frame)
        for name in ('stamp_ns', 'position', 'covariance', 'friction', 'sigma', 'block'):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
