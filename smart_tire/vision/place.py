# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""
Place of the camera above the floor from markers on it, and of the tags on a robot that turns.

A marker lies flat in ``map``, its center where it was measured; how it is turned is not used. The
markers of a printed board are the same, at places known better. Pose of the camera, places and
directions of the markers, and the inset of the detected edges (``localization``) are fitted to the
corners, whose noise is estimated from the residuals; the measured places are priors.

Of a tag, the lateral displacement in ``base_link`` is the change of yaw times ``l_x - S``, B(4);
straight motion shows its yaw. In a turn in place, whose distance the wheels show, the forward
displacement is minus the change of yaw times ``l_y - y``. Where the center of rotation (S, y) of a
skid-steer robot is cannot be seen: its uncertainty is part of that of the tag.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
import math
from typing import Any

import cv2
import numpy as np

from smart_tire.arrays import Array
from smart_tire.errors import EstimatorError
from smart_tire.numerics.least_squares import Errors, nonlinear_fit, Prior
from smart_tire.parameters import RobotParams
from smart_tire.parameters.overhead import OverheadParams
from smart_tire.recording import SampleArrays
from smart_tire.rotation import angles, matrix, wrapped
from smart_tire.samples import LEFT, NS_PER_S, RIGHT
from smart_tire.uncertain import Uncertain
from smart_tire.vision.camera import Camera, Intrinsics
from smart_tire.vision.localization import (
    aligned, Fix, inward, NOMINAL_INSET, square, START_NOISE, START_WEIGHT, turn)
from smart_tire.vision.motion import ICR_SHARES, pixel_noise, time_offset, used, wheel_tracks

MIN_MARKERS = 2          # one, whose direction is not known, does not show the yaw of the camera
STARTS = 4               # of the fit: both poses by the markers that show them best
MIN_IMAGES = 5           # of a marker
MAX_SPREAD = 0.5         # pixels, of a corner over the images: the camera or a marker has moved
MAX_ROTATION_SIGMA = 0.02  # rad, of the camera: a share of its height as error of a position
CONTRADICTION_SIGMAS = 4.0  # of a measured place
INTERVAL = 0.4           # s, of displacements
STRAIGHT, TURNED = 0.05, 0.1  # rad in an interval: at most, at least
MIN_DISTANCE = 0.05      # m in an interval of straight motion
IN_PLACE = 0.2           # distance of the middle over half the difference of the sides
MIN_INTERVALS = 5        # of each kind
MIN_YAW_SIGMA = 1e-4     # rad, of a yaw that is given as exact


def marker_corners(seen: Mapping[int, Sequence[Array]]) -> dict[int, Array]:
    """
    Return the mean corners (4, 2) [pixels] of markers by id, from those in several images.

    Raises EstimatorError if a marker moves in the image.
    """
    found = {}
    for marker, quads in seen.items():
        if len(quads) >= MIN_IMAGES:
            found[marker] = np.median(quads, axis=0)
            if (spread := float(np.std(quads, axis=0).max())) > MAX_SPREAD:
                raise EstimatorError(f'marker {marker} moves by {spread:.1f} pixels in the image: '
                                     'the camera or the marker was moved')
    return found


def camera_place(intrinsics: Intrinsics, corners: Mapping[int, Array], params: OverheadParams
                 ) -> tuple[Array, Array, float]:
    """
    Return position [m] and angles [rad] of the camera (6,), covariance (6, 6), noise [pixels].

    ``corners`` are those of markers of ``floor_ids`` [pixels], (4, 2) by id. Raises EstimatorError
    if they do not determine the pose, or contradict the places given.
    """
    given = dict(zip(params.floor_ids, np.reshape(params.floor_position, (-1, 2))))
    ids = [one for one in params.floor_ids if one in corners]
    if len(ids) < MIN_MARKERS:
        raise EstimatorError(f'{len(ids)} of the markers {list(params.floor_ids)} are in the '
                             f'images, expected at least {MIN_MARKERS}')
    pixels, places = np.array([corners[one] for one in ids]), np.array([given[one] for one in ids])
    flat = square(params.floor_size)

    def rows(values: Array, noise: float) -> Array:
        camera, free = Camera(intrinsics, values[:3], values[3:6]), values[7:].reshape(-1, 3)
        points = [np.column_stack([place[:2] + flat @ turn(place[2]).T, np.zeros(4)])
                  for place in free]
        error = pixels - camera.pixels(np.array(points)) - values[6] * inward(
            pixels).reshape(pixels.shape)
        measured = (places - free[:, :2]) / params.floor_position_sigma
        return np.concatenate([error.ravel() / noise, measured.ravel()])

    def fitted(start: Array, noise: float) -> Any:
        from scipy.optimize import least_squares  # at first use: takes a part of a second
        return least_squares(rows, start, args=(noise,), x_scale='jac')

    starts = sorted(_starts(intrinsics, pixels, places, flat), key=lambda start: float(
        np.sum(rows(start, START_NOISE) ** 2)))
    best = min((fitted(start, START_NOISE) for start in starts[:STARTS]), key=lambda one: one.cost)
    squares = float(np.sum((START_NOISE * best.fun[:pixels.size]) ** 2))
    freedom = 5 * len(ids) - 4  # 8 n less 3 n + 7 unknowns, of which 3 are a motion of the floor
    noise = math.sqrt((START_WEIGHT * START_NOISE ** 2 + squares) / (START_WEIGHT + freedom))
    best = fitted(best.x, noise)
    covariance = np.linalg.inv(best.jac.T @ best.jac)[:6, :6]
    worst = int(np.argmax(np.abs(best.fun[pixels.size:])))
    if abs(best.fun[pixels.size + worst]) > CONTRADICTION_SIGMAS:
        error = math.dist(places[worst // 2], best.x[7:].reshape(-1, 3)[worst // 2, :2])
        raise EstimatorError(f'marker {ids[worst // 2]} is {error:.3f} m from its '
                             'overhead.floor_position, by the other markers')
    if (sigma := math.sqrt(np.max(np.diag(covariance)[3:]))) > MAX_ROTATION_SIGMA:
        raise EstimatorError(
            f'standard error of the rotation of {sigma:.2g} rad, expected at most '
            f'{MAX_ROTATION_SIGMA:g}: place the markers further apart, not on a line')
    return np.concatenate([best.x[:3], angles(matrix(*best.x[3:6]))]), covariance, noise


def _starts(intrinsics: Intrinsics, pixels: Array, places: Array, flat: Array) -> list[Array]:
    """Return start values, from both poses (IPPE) by each marker."""
    camera, found = Camera(intrinsics, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), []
    for quad in pixels:
        _, turns, shifts, _ = cv2.solvePnPGeneric(
            np.column_stack([flat, np.zeros(4)]), camera.rays(quad)[:, None], np.eye(3), None,
            flags=cv2.SOLVEPNP_IPPE_SQUARE)
        for rotation, shift in zip(turns, shifts):
            own = cv2.Rodrigues(rotation)[0].T  # from the optical frame to the marker
            position = -own @ shift.ravel()
            points = Camera(intrinsics, position, angles(own)).floor(pixels, 0.0)  # (n, 4, 2)
            if not np.isfinite(points).all():
                continue
            yaw, moved = aligned(points.mean(1), places)
            edges = points[:, 1] - points[:, 0]
            rotated = matrix(0.0, 0.0, yaw)
            found.append(np.concatenate([
                rotated @ position + (*moved, 0.0), angles(rotated @ own), [NOMINAL_INSET],
                np.column_stack([places, np.arctan2(edges[:, 1], edges[:, 0]) + yaw]).ravel()]))
    return found


def tag_place(fixes: Sequence[Fix], inputs: SampleArrays, robot: RobotParams, icr_x: Uncertain,
              yaw: Uncertain) -> tuple[Uncertain | None, Uncertain | None, Uncertain | None]:
    """
    Return x, y [m] and yaw [rad] of a tag in ``base_link``.

    x and y are None without a turn in place, yaw without straight motion; ``yaw`` is used then.
    ``fixes`` are poses of the tag itself, ``inputs`` has ``wheel_states``; ``icr_x`` [m] is S.
    Raises EstimatorError without both, or if the wheels do not show them.
    """
    moved, turned, rolled, difference = _displacements(fixes, inputs, robot)
    straight = (np.abs(turned) < STRAIGHT) & (np.hypot(*moved.T) > MIN_DISTANCE)
    in_place = (np.abs(turned) > TURNED) & (np.abs(rolled) < 0.5 * IN_PLACE * np.abs(difference))
    start, prior = yaw.value, (yaw.value, max(yaw.sigma, MIN_YAW_SIGMA))
    seen = straight.sum() >= MIN_INTERVALS, in_place.sum() >= MIN_INTERVALS
    if seen[0]:
        forward = np.sum(moved[straight] * np.sign(rolled[straight, None]), axis=0)
        start = -math.atan2(forward[1], forward[0])
    elif not seen[1]:
        raise EstimatorError('neither straight motion nor a turn in place')
    across, chord = straight | in_place, 2.0 * np.sin(0.5 * turned)

    def residual(values: Array) -> Array:
        cos, sin = math.cos(values[2]), math.sin(values[2])
        return np.concatenate([
            (moved @ (sin, cos) - chord * values[0])[across],
            (moved @ (cos, -sin) - rolled + chord * values[1])[in_place]])

    fit = nonlinear_fit(residual, np.array([0.0, 0.0, start]), Prior.of(
        None, None, None if seen[0] else prior), lambda _: np.zeros(across.sum() + in_place.sum()),
        Errors(lags=1, group=np.repeat([0, 1], [across.sum(), in_place.sum()])))
    centers = icr_x, Uncertain(0.0, ICR_SHARES[0] * robot.wheelbase)
    x, y, angle = (fit.estimate(i) for i in range(3))
    x, y = (Uncertain(one.value + center.value, math.hypot(one.sigma, center.sigma))
            for one, center in zip((x, y), centers))
    return (x if seen[1] else None, y if seen[1] else None,
            Uncertain(math.remainder(angle.value, math.tau), angle.sigma) if seen[0] else None)


def _displacements(fixes: Sequence[Fix], inputs: SampleArrays, robot: RobotParams
                   ) -> tuple[Array, Array, Array, Array]:
    """
    Return displacements (n, 2) [m] of a tag in its axes, and how far it turned [rad] (n,).

    And, by the wheels, the distance of the middle and the difference of the sides [m], (n,) each.
    """
    parts = used(sorted(fixes, key=lambda one: one.stamp_ns), pixel_noise(fixes), Counter())
    offset, _ = time_offset(parts, inputs, robot)
    pairs: list[tuple[Fix, Fix]] = []
    for part in parts:
        first = part[0]
        for fix in part:
            if fix.stamp_ns - first.stamp_ns >= INTERVAL * NS_PER_S:
                pairs.append((first, fix))
                first = fix
    if not pairs:
        raise EstimatorError('the tag is not seen long enough')
    begin, end = (np.array([pair[i].pose for pair in pairs]) for i in range(2))
    turned = wrapped(end[:, 2] - begin[:, 2])
    moved = np.einsum('kji,kj->ki', turn(begin[:, 2] + 0.5 * turned), (end - begin)[:, :2])
    stamps = np.array([[fix.stamp_ns for fix in pair] for pair in pairs])
    rolled = np.full((len(pairs), 4), np.nan)
    for i, one in enumerate(wheel_tracks(inputs, robot)):
        if one is not None:
            first_ns, track = one
            time = (stamps - first_ns) / NS_PER_S - offset.value
            angle = np.interp(time, track.times, track.values[:, 0], np.nan, np.nan)
            rolled[:, i] = robot.wheel_radius * np.diff(angle)[:, 0]
    known = np.isfinite(rolled).all(1)
    if not known.any():
        raise EstimatorError('no wheel_states while the tag is seen')
    left, right = rolled[known][:, list(LEFT)].mean(1), rolled[known][:, list(RIGHT)].mean(1)
    return moved[known], turned[known], 0.5 * (left + right), right - left
