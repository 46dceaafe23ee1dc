# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Rasters of friction: files of map_server, lookup, speed mask."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from smart_tire.errors import ParameterError
from smart_tire.mapping.raster import (
    grid_of, pixels, png_bytes, png_image, Raster, read_raster, speed_mask, write_image,
    write_raster)
from smart_tire.parameters.path_following import FrictionLimitParams
import yaml

FRICTION = np.array([[0.1, 0.2, np.nan], [0.47, 1.3, 0.0]])
SIGMA = np.array([[0.011, 0.02, np.nan], [0.03, 0.2, 0.001]])
RASTER = Raster('map', 0.1, (-1.0, 2.0), FRICTION, SIGMA)


@pytest.fixture
def written(tmp_path):
    """Return the YAML file of ``RASTER``."""
    write_raster(tmp_path / 'm.yaml', RASTER)
    return tmp_path / 'm.yaml'


def occupancy(path):
    """Return the data that map_server publishes in its mode raw, row 0 at the smallest y."""
    given = yaml.safe_load(path.read_text())
    assert given['mode'] == 'raw' and given['negate'] == 0
    assert 0.0 <= given['free_thresh'] < given['occupied_thresh'] <= 1.0
    image = cv2.imread(str(path.parent / given['image']), cv2.IMREAD_UNCHANGED)
    assert image.dtype == np.uint8 and image.ndim == 2
    return np.where(image <= 100, image.astype(int), -1)[::-1]


def test_map_server_reads_100_mu_and_unknown_cells(written):
    assert occupancy(written).tolist() == [[10, 20, -1], [47, 100, 0]]
    assert yaml.safe_load(written.read_text())['origin'] == [-1.0, 2.0, 0.0]


def test_a_map_is_read_as_it_was_written_but_for_its_resolution(written):
    found = read_raster(written)
    assert (found.frame, found.resolution, found.origin) == ('map', 0.1, (-1.0, 2.0))
    np.testing.assert_allclose(found.friction, np.minimum(FRICTION, 1.0), atol=0.005)
    assert (np.isnan(found.sigma) == np.isnan(SIGMA)).all()
    known = np.isfinite(SIGMA)
    assert (found.sigma[known] >= SIGMA[known]).all()  # never more certain
    np.testing.assert_allclose(found.sigma, SIGMA, atol=0.01)


@pytest.mark.parametrize('strategy', [
    cv2.IMWRITE_PNG_STRATEGY_DEFAULT, cv2.IMWRITE_PNG_STRATEGY_FILTERED])
@pytest.mark.parametrize('smooth', [True, False])
def test_images_of_other_programs_are_read(tmp_path, strategy, smooth):
    rng = np.random.default_rng(3)
    image = rng.integers(0, 256, (40, 31), np.uint8)
    if smooth:  # so that libpng uses all its filters
        image = cv2.GaussianBlur(image, (0, 0), 4.0)
    path = str(tmp_path / 'a.png')
    cv2.imwrite(path, image, [cv2.IMWRITE_PNG_STRATEGY, strategy])
    assert (png_image((tmp_path / 'a.png').read_bytes()) == image).all()


@pytest.mark.parametrize('kind', range(5))
def test_each_filter_of_a_png_is_undone(kind):
    image = np.random.default_rng(kind).integers(0, 256, (7, 5), np.uint8)
    values, lines = image.astype(int), []
    for row in range(7):
        up = values[row - 1] if row else np.zeros(5, int)
        left, corner = (np.append(0, one[:-1]) for one in (values[row], up))
        guess = left + up - corner
        paeth = [min(three, key=lambda one, g=g: abs(g - one)) for g, three in zip(
            guess, zip(left, up, corner))]
        lines.append(np.append(kind, (values[row] - [
            0 * up, left, up, (left + up) // 2, paeth][kind]) % 256).astype(np.uint8))
    from smart_tire.mapping.raster import _unfiltered
    assert (_unfiltered(np.array(lines)) == image).all()


def test_a_png_has_its_last_row_at_the_top():
    image = np.array([[1, 2], [3, 4]], np.uint8)
    assert png_image(png_bytes(image)).tolist() == [[3, 4], [1, 2]]


def damaged(data, at):
    """Return ``data`` with one bit changed."""
    return data[:at] + bytes([data[at] ^ 1]) + data[at + 1:]


@pytest.mark.parametrize(('change', 'named'), [
    (lambda data: data[:-30], 'm.png'), (lambda data: damaged(data, 45), 'm.png: damaged'),
    (lambda data: b'', 'not a PNG'), (lambda data: damaged(data, 24), 'm.png: damaged')])
def test_a_damaged_image_is_refused_in_one_line(written, change, named):
    image = written.with_suffix('.png')
    image.write_bytes(change(image.read_bytes()))
    with pytest.raises(ParameterError, match=named) as error:
        read_raster(written)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize(('old', 'new', 'named'), [
    ('mode: raw', 'mode: trinary', 'trinary'), ('mode: raw', 'mode: [', 'line'),
    ('resolution: 0.1', 'resolution: -1', 'resolution'),
    ('resolution: 0.1', 'resolution: .nan', 'resolution'),
    ('origin: [-1.0, 2.0, 0.0]', 'origin: [-1.0, 2.0, 0.5]', 'yaw'),
    ('origin: [-1.0, 2.0, 0.0]', 'origin: 5', 'no friction map'),
    ('sigma_image: m_sigma.png', '', 'sigma_image is missing'),
    ('image: m.png', 'image: none.png', 'none.png: cannot be read')])
def test_a_wrong_map_file_is_refused_in_one_line(written, old, new, named):
    text = written.read_text()
    assert old in text
    written.write_text(text.replace(old, new, 1))
    with pytest.raises(ParameterError, match=named) as error:
        read_raster(written)
    assert len(str(error.value).splitlines()) == 1


def test_images_of_different_sizes_and_missing_files_are_refused(written):
    written.with_name('m_sigma.png').write_bytes(png_bytes(np.zeros((1, 1), np.uint8)))
    with pytest.raises(ParameterError, match='different sizes'):
        read_raster(written)
    with pytest.raises(ParameterError, match='absent.yaml: cannot be read'):
        read_raster(written.with_name('absent.yaml'))


def test_the_lower_bound_is_that_of_the_cell_and_unknown_elsewhere():
    x, y = np.array([-0.95, -0.85, -0.75, -1.05, -0.95, 1e9]), np.full(6, 2.05)
    y[4] = 2.21
    np.testing.assert_allclose(RASTER.lower_bound(x, y, 2.0),
                               [0.1 - 0.022, 0.2 - 0.04, np.nan, np.nan, np.nan, np.nan])


def test_the_lower_bound_of_a_map_in_another_frame():
    pose = 3.0, -4.0, 0.7  # of the map in the frame of the positions
    x, y = np.array([-0.95, -0.85]), np.array([2.05, 2.15])
    cos, sin = math.cos(0.7), math.sin(0.7)
    found = RASTER.lower_bound(3.0 + cos * x - sin * y, -4.0 + sin * x + cos * y, 0.0, pose)
    np.testing.assert_allclose(found, [0.1, 1.3])


def test_unknown_cells_may_be_as_slippery_as_known_ones_near_them():
    rng = np.random.default_rng(3)
    friction = np.where(rng.random((7, 9)) < 0.2, rng.uniform(0.05, 0.6, (7, 9)), np.nan)
    sigma = np.where(np.isfinite(friction), rng.uniform(0.01, 0.1, (7, 9)), np.nan)
    raster = Raster('map', 0.1, (1.0, -2.0), friction, sigma)
    found = raster.widened(0.31, 2.0)
    assert found.origin == pytest.approx((0.7, -2.3)) and found.friction.shape == (13, 15)
    padded = [np.pad(one, 3, constant_values=np.nan) for one in (friction, sigma)]
    for row, column in np.ndindex(13, 15):
        near = [one[max(row - 3, 0):row + 4, max(column - 3, 0):column + 4] for one in padded]
        expected = [one[row, column] for one in padded]
        if np.isnan(expected[0]) and np.isfinite(near[0]).any():
            least = np.nanargmin(near[0] + 2.0 * near[1])
            expected = [one.ravel()[least] for one in near]
        np.testing.assert_allclose(
            [found.friction[row, column], found.sigma[row, column]], expected, rtol=1e-12)
    assert raster.widened(0.3, 2.0).friction.shape == (13, 15)  # 0.3 / 0.1 is a bit less than 3
    same = raster.widened(0.0, 2.0)
    np.testing.assert_equal(same.friction, friction)
    assert same.origin == raster.origin


def test_pixels_round_and_clip():
    assert pixels(np.array([[0.004, 0.006, 1.7, np.nan]])).tolist() == [[0, 1, 100, 255]]
    assert pixels(np.array([[0.001, 0.02]]), upwards=True).tolist() == [[1, 2]]


def test_the_grid_of_a_raster_has_its_cells_row_by_row():
    grid = grid_of(RASTER, 5)
    assert (grid.stamp_ns, grid.frame, grid.columns, grid.origin) == (5, 'map', 3, (-1.0, 2.0))
    assert list(grid.values) == [10, 20, 255, 47, 100, 0]


def test_a_robot_stops_within_the_distance_from_the_speed_in_the_mask(tmp_path):
    params, distance, fastest = FrictionLimitParams(), 0.5, 2.0
    mask = speed_mask(RASTER, params, distance, fastest)
    lower = np.maximum(FRICTION - params.sigmas * SIGMA, params.minimum)
    speed = mask * 0.01 * fastest
    limited = (mask > 0) & np.isfinite(FRICTION)
    braking = speed ** 2 / (2.0 * params.share * 9.80665 * lower)
    assert (braking[limited] <= distance).all() and limited.sum() >= 3
    assert mask[0, 2] == 0  # SpeedFilter: no limit, where nothing is known; -1 is an error there
    assert mask[1, 1] == 0  # faster than the robot
    assert 0 < mask[1, 2] < mask[0, 0] < mask[0, 1]
    write_image(tmp_path / 's.yaml', RASTER, mask)
    assert (occupancy(tmp_path / 's.yaml') == mask).all()
