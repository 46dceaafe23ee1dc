# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Places of the camera and of the tags: errors within their sigmas, and refusals."""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np
import pytest
from smart_tire.errors import EstimatorError, ParameterError
from smart_tire.identification.camera import camera_parameters
from smart_tire.parameters import load_node, RobotParams
from smart_tire.parameters.calibration_file import identified_text
from smart_tire.parameters.overhead import ImageParams, OverheadParams
from smart_tire.recording import SampleArrays
from smart_tire.uncertain import Uncertain
from smart_tire.vision.camera import Camera, Intrinsics
from smart_tire.vision.detection import TagDetector
from smart_tire.vision.localization import inward, PoseFit, square, turn
from smart_tire.vision.place import camera_place, marker_corners, tag_place
from smart_tire.vision.renderer import Renderer
from support.overhead import camera, corners, fixes_of, imu_samples, K, RADIUS, wheel_samples

ROBOT = RobotParams()
EXACT = Uncertain(0.0, 0.0)
INNER = camera((-0.1, 0.02, 0.001, -0.001, 0.0)).intrinsics
CORNERS = ((0.9, 0.5), (-0.8, 0.45), (-0.9, -0.5), (0.85, -0.6))


def scene(seed, places=CORNERS, noise=0.05, sigma=0.002, size=0.16):
    """Return parameters, corners by id and the true place (6,) of a camera, in a random scene."""
    rng = np.random.default_rng(seed)
    true = np.array([*rng.uniform(-0.3, 0.3, 2), rng.uniform(2.5, 4.0),
                     math.pi + rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), rng.uniform(-3, 3)])
    one, found = Camera(INNER, true[:3], true[3:]), {}
    for i, place in enumerate(places):
        flat = place + square(size) @ turn(rng.uniform(-3, 3)).T
        pixels = one.pixels(np.column_stack([flat, np.zeros(4)]))
        found[10 + i] = pixels + 0.6 * inward(pixels) + noise * rng.standard_normal((4, 2))
    measured = np.array(places) + sigma * rng.standard_normal((len(places), 2))
    return OverheadParams(
        floor_ids=tuple(found), floor_position=tuple(measured.ravel().tolist()), floor_size=size,
        floor_position_sigma=sigma), found, true


def difference(place, true):
    """Return the error of a place, its angles between -pi and pi."""
    error = place - true
    error[3:] = np.remainder(error[3:] + math.pi, math.tau) - math.pi
    return error


@pytest.fixture(scope='module')
def calibrated():
    """Return by number of markers the scenes, each with the place of its camera as estimated."""
    return {count: [(*one, *camera_place(INNER, one[1], one[0])) for one in (
        scene(seed, CORNERS[:count]) for seed in range(12))] for count in (2, 4)}


@pytest.mark.parametrize('count', [2, 4])
def test_errors_of_the_camera_are_within_their_sigmas(count, calibrated):
    squares, sigmas = [], []
    for _, _, true, place, covariance, noise in calibrated[count]:
        error = difference(place, true)
        squares.append(error @ np.linalg.solve(covariance, error))
        sigmas.append(np.sqrt(np.diag(covariance)))
        assert 0.02 < noise < 0.12
    assert 0.5 < np.mean(squares) / 6.0 < 1.6
    assert max(squares) < 25.0  # chi-square of 6 degrees: 1 in 3000
    assert np.median(sigmas, axis=0)[3:].max() < (0.003 if count == 4 else 0.01)


def test_errors_of_poses_are_those_of_the_parameter_file_of_the_camera(calibrated, tmp_path):
    """With the sigmas of the camera alone, the mean square of x and y would be 0.04."""
    rng, squares, file = np.random.default_rng(8), [], tmp_path / 'overhead.yaml'
    for *_, true, place, covariance, _ in calibrated[4]:
        file.write_text(identified_text([], camera_parameters(place, covariance)),
                        encoding='utf-8')
        params = load_node([file], 'overhead_localizer').overhead
        assert params.camera_errors @ params.camera_errors.T == pytest.approx(
            covariance, rel=1e-4, abs=1e-12)
        fit = PoseFit(Camera(INNER, params.camera_position, params.camera_rotation), params,
                      RADIUS)
        pose = np.array([*rng.uniform(-0.6, 0.6, 2), rng.uniform(-3.0, 3.0)])
        seen = corners(Camera(INNER, true[:3], true[3:]), params, pose)
        fix = fit.fix(1, {0: seen[0] + 0.05 * rng.standard_normal((4, 2))})
        error = fix.pose - pose
        error[2] = math.remainder(error[2], math.tau)
        spread = fix.calibration + 0.05 ** 2 * fix.shape
        squares.append([error[:2] @ np.linalg.solve(spread[:2, :2], error[:2]) / 2.0,
                        error @ np.linalg.solve(spread, error) / 3.0])
    means = np.mean(squares, axis=0)
    assert means.min() > 0.5 and means.max() < 1.7


def test_the_markers_of_a_rendered_floor_show_the_camera():
    image = ImageParams(rotation=(math.pi - 0.1, 0.08, 2.0), position=(0.1, -0.1, 3.0),
                        shadow=0.0)
    params = OverheadParams(
        floor_ids=(10, 11, 12, 13), floor_position_sigma=0.0005,
        floor_position=(0.8, 0.4, -0.8, 0.4, -0.7, -0.5, 0.8, -0.5))
    renderer, seen = Renderer(image, params, RADIUS), {one: [] for one in params.floor_ids}
    for time in range(5):
        tags, _ = TagDetector('36h11').tags(renderer.image(time, lambda times: np.zeros(
            (len(times), 3))))
        for one in seen.keys() & tags.keys():
            seen[one].append(tags[one])
    place, covariance, _ = camera_place(renderer.camera.intrinsics, marker_corners(seen), params)
    error = difference(place, np.array([*image.position, *image.rotation]))
    assert error @ np.linalg.solve(covariance, error) < 20.0
    assert np.sqrt(np.diag(covariance)).max() < 0.01 and np.abs(error).max() < 0.015


def refused(params, corners):
    """Return why a place is refused."""
    with pytest.raises(EstimatorError) as error:
        camera_place(INNER, corners, params)
    return str(error.value)


def test_a_camera_that_the_markers_do_not_determine_is_refused_with_the_reason():
    params, corners, _ = scene(1)
    assert refused(params, {10: corners[10], 3: corners[11]}) == (
        '1 of the markers [10, 11, 12, 13] are in the images, expected at least 2')
    shifted = np.array(params.floor_position)
    shifted[4] += 0.03
    assert refused(replace(params, floor_position=tuple(shifted)), corners).startswith(
        'marker 12 is 0.0')
    line = [(x, 0.5 * x) for x in (-0.6, 0.0, 0.6)]  # small ones: only their places count
    assert 'on a line' in refused(*scene(2, line, size=0.03)[:2])
    near = [(x, y) for x in (-0.05, 0.05) for y in (-0.05, 0.05)]
    assert 'further apart' in refused(*scene(3, near, size=0.04)[:2])


def test_a_marker_that_moves_is_refused_and_one_that_is_rarely_seen_is_left_out():
    quad = square(50.0) + 300.0
    assert marker_corners({1: [quad] * 5, 2: [quad] * 4}).keys() == {1}
    with pytest.raises(EstimatorError, match='marker 1 moves by 1.5 pixels'):
        marker_corners({1: [quad, quad + 3.0] * 5})


def drive(time, icr=0.0, *, turns=True, straight=True):
    """Return x, y, yaw of a robot: forward and back, a turn to each side about x = ``icr``."""
    def ramp(begin, end):
        return min(max(time, begin), end) - begin
    way = 0.4 * (ramp(1.0, 3.0) - ramp(3.0, 4.0)) if straight else 0.0
    yaw = 0.3 + turns * 0.8 * (ramp(5.0, 7.5) - ramp(8.0, 11.0))
    x, y = math.cos(0.3) * way, math.sin(0.3) * way
    return np.array([x - icr * (math.cos(yaw) - math.cos(0.3)),
                     y - icr * (math.sin(yaw) - math.sin(0.3)), yaw])


def recording(*, icr=0.0, place=(0.05, -0.03), yaw=0.4, seed=0, wheels=True, **legs):
    """Return poses of a tag, and samples of gyroscope and wheels, which slip by 15 % in turns."""
    def tag(time):
        x, y, angle = drive(time, icr, **legs)
        cos, sin = math.cos(angle), math.sin(angle)
        return (x + cos * place[0] - sin * place[1], y + sin * place[0] + cos * place[1],
                angle + yaw)

    def rates(time):
        step = (drive(time + 1e-4, icr, **legs) - drive(time - 1e-4, icr, **legs)) / 2e-4
        forward = math.cos(drive(time)[2]) * step[0] + math.sin(drive(time)[2]) * step[1]
        return forward, step[2]

    def speeds(time):
        forward, rate = rates(time)
        side = 0.5 * ROBOT.track_width * rate / 0.85 * np.array([-1.0, 1.0, -1.0, 1.0])
        return (forward + side) / ROBOT.wheel_radius

    fixes = fixes_of(tag, duration=11.0, noise=3e-4, seed=seed)
    return fixes, SampleArrays([*imu_samples(lambda time: rates(time)[1], 13.0), *(
        wheel_samples(speeds, 13.0) if wheels else ())])


def test_errors_of_a_tag_are_within_their_sigmas():
    normalized = []
    for seed in range(4):
        fixes, inputs = recording(seed=seed)
        x, y, yaw = tag_place(fixes, inputs, ROBOT, EXACT, EXACT)
        assert abs(y.value + 0.03) < 0.003 < 0.012 < y.sigma < 0.014  # of the center of rotation
        assert x.sigma < 0.001 and yaw.sigma < 0.004
        normalized.append([(x.value - 0.05) / x.sigma, (yaw.value - 0.4) / yaw.sigma])
    assert np.abs(normalized).max() < 4.0
    assert (np.mean(np.square(normalized), axis=0) < 2.5).all()


def test_the_center_of_rotation_is_part_of_the_place_and_of_its_sigma():
    fixes, inputs = recording(icr=0.04)
    x, _, yaw = tag_place(fixes, inputs, ROBOT, Uncertain(0.04, 0.01), EXACT)
    assert (x.value, yaw.value) == (pytest.approx(0.05, abs=2e-3), pytest.approx(0.4, abs=0.01))
    assert x.sigma == pytest.approx(0.01, rel=0.05)
    x, *_ = tag_place(fixes, inputs, ROBOT, Uncertain(0.0, 0.05), EXACT)
    assert x.value == pytest.approx(0.01, abs=2e-3) and x.sigma > 0.049


def test_a_tag_that_looks_back_is_found_by_the_direction_of_the_wheels():
    *_, yaw = tag_place(*recording(yaw=3.1), ROBOT, EXACT, EXACT)
    assert math.remainder(yaw.value - 3.1, math.tau) == pytest.approx(0.0, abs=0.01)


def test_what_a_recording_does_not_show_of_a_tag_is_not_given():
    x, y, yaw = tag_place(*recording(turns=False), ROBOT, EXACT, EXACT)
    assert x is None and y is None and yaw.value == pytest.approx(0.4, abs=0.01)
    x, y, yaw = tag_place(*recording(straight=False), ROBOT, EXACT, Uncertain(0.4, 0.01))
    assert yaw is None and x.value == pytest.approx(0.05, abs=2e-3)
    with pytest.raises(EstimatorError, match='neither straight motion nor a turn in place'):
        tag_place(*recording(turns=False, straight=False), ROBOT, EXACT, EXACT)
    with pytest.raises(EstimatorError, match='no wheel_states'):
        tag_place(*recording(wheels=False), ROBOT, EXACT, EXACT)
    with pytest.raises(EstimatorError, match='not seen long enough'):
        fixes, inputs = recording()
        tag_place(fixes[:4], inputs, ROBOT, EXACT, EXACT)


FILE = """image_width: 1280
image_height: 720
camera_name: overhead
camera_matrix: {rows: 3, cols: 3, data: [900.0, 0.0, 640.0, 0.0, 905.0, 360.0, 0.0, 0.0, 1.0]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.1, 0.02, 0.0, 0.0, 0.0]}
"""


def test_the_file_of_a_calibration_is_read_and_others_are_refused(tmp_path):
    file = tmp_path / 'camera.yaml'
    file.write_text(FILE, encoding='utf-8')
    assert not Intrinsics.from_file(str(file)).differs(
        Intrinsics((1280, 720), K, np.array([-0.1, 0.02, 0.0, 0.0, 0.0])))
    for text in ('', 'a: 1', '[', FILE.replace('plumb_bob', 'x'), FILE.replace('900.0', '0.0'),
                 FILE.replace('[900.0, 0.0,', '[')):
        file.write_text(text, encoding='utf-8')
        with pytest.raises(ParameterError, match='overhead.camera_info_file: .*no calibration'):
            Intrinsics.from_file(str(file))
    with pytest.raises(ParameterError, match='no calibration'):
        Intrinsics.from_file(str(tmp_path / 'missing'))
