# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Paths from files: CSV, or the poses recorded in a bag."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import math
from pathlib import Path

from smart_tire.bags import Bag
from smart_tire.control.path_library import PATHS
from smart_tire.errors import BagError, ParameterError
from smart_tire.paths import BAG_SUFFIXES, csv_rows, find_bag, is_number
from smart_tire.rotation import yaw_of
from smart_tire.samples import NAN, Odometry, Vector3

COLUMNS = ('x', 'y', 'yaw')
HEADERS = (COLUMNS[:2], COLUMNS)
COMMENT = '#'
RECORDED_SPACING = 0.05  # m between poses taken from a bag
MAX_SIZE = 1 << 26       # bytes of a CSV file: a million poses, thousands of kilometers
MAX_COORDINATE = 1e5     # m; farther is not driven: probably other units or a map projection
MAX_AWAY = math.sin(math.radians(15.0))  # of a yaw along the path, from the steps around a pose

Poses = tuple[Vector3, ...]  # m, m, rad: x, y, yaw; yaw is NaN where it is not given


def read_plan(name: str, scale: float) -> Poses:
    """
    Return the poses of one of ``PATHS``, or of a path file, with lengths times ``scale``.

    Raises ParameterError if there is none of this name.
    """
    if name in PATHS:
        return PATHS[name](scale).poses
    if not Path(name).exists():
        raise ParameterError(f'--path {name}: no such file, and not one of {", ".join(PATHS)}')
    return scaled(read_path(Path(name)), scale)


def read_path(path: Path) -> Poses:
    """
    Return the poses in a CSV file, or those of ``odom`` in a bag.

    Raises ParameterError, with the line, if a file is wrong or contains no path.
    """
    if path.is_dir() or path.name.endswith(BAG_SUFFIXES):
        poses: Poses = tuple(_recorded(path))
    else:
        poses = tuple(_rows(path))
        if _in_degrees(poses):
            raise ParameterError(
                f'{path}: yaw is up to {max((yaw for _, _, yaw in poses), key=abs):g}, expected '
                'rad; in degrees? Convert it, or leave the column out')
    if not any(pose[:2] != poses[0][:2] for pose in poses):
        raise ParameterError(f'{path}: {len(poses)} poses, expected a path of two places or more')
    return poses


def _in_degrees(poses: Poses) -> bool:
    """
    Return whether the yaws are degrees: those of rad contradict the path, or exceed a turn.

    More than a turn is possible if it was counted on. A robot may turn in place at some poses, and
    drive backwards.
    """
    beyond = any(abs(yaw) > math.tau for _, _, yaw in poses)
    directions = [math.atan2(b[1] - a[1], b[0] - a[0]) if a[:2] != b[:2] else NAN
                  for a, b in zip(poses, poses[1:])]
    rad, degrees = (sorted(
        min(abs(math.sin(factor * yaw - one)) for one in around if not math.isnan(one))
        for (_, _, yaw), around in zip(poses, zip([NAN, *directions], [*directions, NAN]))
        if not all(map(math.isnan, around)) and abs(yaw) > (math.tau if beyond else 0.0))
        for factor in (1.0, math.radians(1.0)))
    if beyond:
        return not rad or rad[len(rad) // 2] > min(degrees[len(rad) // 2], MAX_AWAY)
    return len(rad) > 2 and rad[len(rad) // 2] > MAX_AWAY > degrees[-1]


def _rows(path: Path) -> Iterator[Vector3]:
    columns = 0
    with csv_rows(path, MAX_SIZE, 'CSV file') as reader:
        for row in reader:
            words = [word.strip() for word in row]
            if not any(words) or words[0].startswith(COMMENT):
                continue
            where = f'{path}, line {reader.line_num}'
            if not columns:
                columns = len(words)
                if _is_header(words, where):
                    continue
            yield _pose(words, columns, where)


def _is_header(words: Sequence[str], where: str) -> bool:
    if tuple(word.lower() for word in words) in HEADERS:
        return True
    if is_number(words[0]):
        return False
    raise ParameterError(f'{where}: header {",".join(words)!r}, expected x,y or x,y,yaw')


def _pose(words: Sequence[str], columns: int, where: str) -> Vector3:
    if len(words) != columns or columns not in (2, 3):
        raise ParameterError(f'{where}: {len(words)} columns, expected '
                             + (f'{columns} as before' if columns in (2, 3) else 'x,y or x,y,yaw'))
    if bad := [word for word in words if not is_number(word)]:
        raise ParameterError(f'{where}: {bad[0]!r} is not a number')
    numbers = [float(word) for word in words]
    for name, number in zip(COLUMNS, numbers):
        if not abs(number) <= MAX_COORDINATE:  # also NaN
            raise ParameterError(f'{where}: {name} is {number}, expected at most '
                                 f'{MAX_COORDINATE:g} in magnitude')
    x, y, yaw = numbers if columns == 3 else [*numbers, NAN]
    return x, y, yaw


def _recorded(path: Path) -> list[Vector3]:
    """Return poses of ``odom`` at distances of ``RECORDED_SPACING``, and the last one."""
    poses: list[Vector3] = []
    latest: Vector3 | None = None
    try:
        with Bag(find_bag(path)) as bag:
            for _, _, sample in bag.samples(['odom']):
                assert isinstance(sample, Odometry)
                latest = *sample.position[:2], yaw_of(sample.orientation)
                if not poses or math.dist(poses[-1][:2], latest[:2]) >= RECORDED_SPACING:
                    poses.append(latest)
    except BagError as error:
        raise ParameterError(str(error)) from error
    if latest is None:
        raise ParameterError(f'{path}: contains no messages on odom')
    return [*poses[:-1], latest] if len(poses) > 1 else poses


def scaled(poses: Poses, scale: float) -> Poses:
    """Return the path with all distances multiplied by ``scale``."""
    return tuple((scale * x, scale * y, yaw) for x, y, yaw in poses)


def placed(poses: Poses, start: Vector3) -> Poses:
    """
    Return the path moved and turned such that its first pose is ``start``.

    Without a yaw the first pose is taken as facing along x: x is ahead of the robot, y to its
    left.
    """
    x_0, y_0, yaw_0 = poses[0]
    turn = start[2] - (0.0 if math.isnan(yaw_0) else yaw_0)
    cos, sin = math.cos(turn), math.sin(turn)
    return tuple((start[0] + cos * (x - x_0) - sin * (y - y_0),
                  start[1] + sin * (x - x_0) + cos * (y - y_0), yaw + turn)
                 for x, y, yaw in poses)


def length(poses: Poses) -> float:
    """Return the length [m] of a path."""
    return sum(math.dist(one[:2], other[:2]) for one, other in zip(poses, poses[1:]))


def extent(poses: Poses) -> float:
    """Return the largest distance [m] of a path from its first pose."""
    return max(math.dist(pose[:2], poses[0][:2]) for pose in poses)
