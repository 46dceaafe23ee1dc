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
A slip estimator of your own, compared with that of the package and with ground truth.

Run it with ``python examples/custom_estimator.py``. The tutorial "Write an estimator of your own"
explains it.
"""

from __future__ import annotations

import numpy as np

from smart_tire import estimate_slip, load_params, Recording, simulate, SlipEstimate
from smart_tire.api import Params

LEFT_OR_RIGHT = np.array([1.0, -1.0, 1.0, -1.0])  # of WHEELS
SIGMA = 0.1  # -, of the neglected common slip


def gyro_slip(recording: Recording, params: Params) -> SlipEstimate:
    """
    Return slip from gyroscope and encoders, if both sides slip equally much but oppositely.

    The mean of all wheels is then the speed of the robot, and the yaw rate gives the speed over
    ground of each side.
    """
    robot, wheels, imu = params.robot, recording.wheels, recording.imu
    rolling = robot.wheel_radius * wheels.velocity  # m/s, (n, 4)
    yaw_rate = np.interp(wheels.stamp_ns, imu.stamp_ns, imu.rate[:, 2])
    speed = rolling.mean(axis=1)
    over_ground = (speed[:, np.newaxis]
                   - 0.5 * robot.track_width * LEFT_OR_RIGHT * yaw_rate[:, np.newaxis])
    moving = np.abs(rolling) > robot.slip.standstill_speed
    ratio = np.where(moving, 1.0 - over_ground / np.where(moving, rolling, 1.0), np.nan)
    return SlipEstimate(
        stamp_ns=wheels.stamp_ns, ratio=np.clip(ratio, -1.0, 1.0),
        sigma=np.where(moving, SIGMA, 1.0), velocity=rolling - over_ground)


def rms_error(found: SlipEstimate, truth: SlipEstimate, after_ns: int) -> float:
    """Return the rms error [-] of the slip ratios from ``after_ns`` on."""
    errors = []
    for wheel in range(4):
        known = np.isfinite(found.ratio[:, wheel]) & (found.stamp_ns >= after_ns)
        true = np.interp(found.stamp_ns[known], truth.stamp_ns, truth.ratio[:, wheel])
        errors.append(found.ratio[known, wheel] - true)
    return float(np.sqrt(np.nanmean(np.concatenate(errors) ** 2)))


def main() -> dict[str, dict[str, float]]:
    """Print and return the rms errors of both estimators on concrete and on sand."""
    errors: dict[str, dict[str, float]] = {}
    print('rms error of the slip ratio   own   package')
    for surface in 'concrete', 'sand':
        params = load_params(values={
            'film.wheels': ['front_left', 'front_right'], 'ground.base': surface,
            'ground.patches.names': []})
        recording = simulate([(0.5, 10.0, 6.0)], 4.0, params=params, seed=1)
        settled_ns = int(recording.imu.stamp_ns[0]) + 2_000_000_000
        errors[surface] = {
            name: rms_error(found, recording.truth.slip, settled_ns)
            for name, found in (('own', gyro_slip(recording, params)),
                                ('package', estimate_slip(recording, params)))}
        print(f'{surface:28}', *(f'{error:7.3f}' for error in errors[surface].values()))
    return errors


if __name__ == '__main__':
    main()
