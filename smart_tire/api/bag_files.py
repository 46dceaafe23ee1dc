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

"""Recordings read from and written to rosbag2 bags."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
import heapq
import math
from operator import itemgetter
from pathlib import Path
from typing import cast

from smart_tire.analysis.bag_params import bag_params
from smart_tire.analysis.pipeline import INPUTS, TRUTHS
from smart_tire.api.params import Params
from smart_tire.api.recording import as_recording, Received, Recording
from smart_tire.api.results import FrictionEstimate, PoseEstimate, SlipEstimate
from smart_tire.arrays import Array
from smart_tire.bags import Bag, BagWriter, PARAMETERS_KEY, TopicNames
from smart_tire.paths import find_bag
from smart_tire.rotation import quaternion
from smart_tire.samples import Four, Friction, FRICTION_QUANTITIES, Odometry, WheelSlip
from smart_tire.uncertain import Uncertain

PLANAR = (0, 1, 5)  # x, y and rotation about z in the covariances of ROS
ZERO = (0.0, 0.0, 0.0)


def read_bag(path: str | Path, *, params: Params | None = None,
             remap: Mapping[str, str] | None = None) -> Recording:
    """
    Return the measurements and the ground truth in a rosbag2 bag.

    ``path`` is a rosbag2 directory, a folder that contains one, or a single file, MCAP or
    sqlite3. Topics may have a namespace or, with ``remap``, other names: ``{'imu/data':
    '/mti30/imu'}``. Recorded estimates are not read. ``Recording.params`` are ``params``, whose
    ``joints`` name the wheels, by default the parameters in the bag. A damaged bag is read up to
    the damage: ``Recording.warnings`` lists what could not be read. Raises BagError if the bag
    cannot be read at all, ParameterError if ``remap`` or a parameter in the bag is invalid.
    """
    with Bag(find_bag(Path(path)), TopicNames(remap or {})) as bag:
        if params is None and bag.parameters:
            params = Params(bag_params(bag).params)
        if params is not None:
            bag.joints = params.robot.joints
        recording = as_recording(bag.samples((*INPUTS, *TRUTHS)), params)
        return replace(recording, warnings=(
            *bag.warnings, *bag.type_mismatches(), *bag.faults.lines()))


def write_bag(path: str | Path, recording: Recording) -> None:
    """
    Write the measurements and the ground truth of ``recording`` to the new bag ``path``.

    ``smart_tire analyze``, ``ros2 bag`` and ``read_bag`` read it, the latter as the same arrays to
    rounding, with the parameters of its estimators. The true pose is written as planar motion.
    Raises BagError if the folder ``path`` exists or cannot be written.
    """
    truth = recording.truth
    truths = heapq.merge(_odometry(truth.pose), _slips(truth.slip), _crossings(truth.friction),
                         key=itemgetter(0))
    params = recording.params
    with BagWriter(path, custom_data={} if params is None else {
            PARAMETERS_KEY: params.estimators.text}) as writer:
        for item in heapq.merge(recording.received(), truths, key=itemgetter(0)):
            writer.write_sample(item.topic, item.receive_ns, item.sample)


def _odometry(pose: PoseEstimate) -> Iterator[Received]:
    for stamp_ns, (x, y, yaw), (v_x, v_y, rate), covariance, sigma in zip(
            pose.stamp_ns.tolist(), pose.pose.tolist(), pose.twist.tolist(), pose.covariance,
            pose.twist_sigma):
        known = not math.isnan(rate)
        linear, angular = ((v_x, v_y, 0.0), (0.0, 0.0, rate)) if known else (ZERO, ZERO)
        yield Received(stamp_ns, 'ground_truth/odom', Odometry(
            stamp_ns, (x, y, 0.0), quaternion(0.0, 0.0, yaw), linear, angular,
            _six_by_six({(i, j): covariance[i, j] for i in range(3) for j in range(3)}),
            _six_by_six({(i, i): sigma[i]**2 for i in range(3)} if known else {(0, 0): -1.0})))


def _six_by_six(entries: dict[tuple[int, int], float]) -> tuple[float, ...]:
    """Return the covariance of ROS with ``entries`` (row, column) of x, y and yaw."""
    numbers = [0.0] * 36
    for (row, column), value in entries.items():
        numbers[6 * PLANAR[row] + PLANAR[column]] = float(value)
    return tuple(numbers)


def _slips(slip: SlipEstimate) -> Iterator[Received]:
    def fours(values: Array) -> list[Four]:
        return [cast(Four, tuple(row)) for row in values.tolist()]

    for stamp_ns, ratio, velocity, sigma in zip(
            slip.stamp_ns.tolist(), fours(slip.ratio), fours(slip.velocity), fours(slip.sigma)):
        yield Received(stamp_ns, 'ground_truth/wheel_slip',
                       WheelSlip(stamp_ns, ratio, velocity, sigma))


def _crossings(friction: FrictionEstimate) -> Iterator[Received]:
    quantities = {name: getattr(friction, name) for name in FRICTION_QUANTITIES}
    for i, (stamp_ns, wheel) in enumerate(zip(friction.stamp_ns.tolist(),
                                              friction.wheel.tolist())):
        yield Received(stamp_ns, 'ground_truth/tire_friction', Friction(stamp_ns, wheel, **{
            name: Uncertain(float(one.value[i]), float(one.sigma[i]))
            for name, one in quantities.items()}))
