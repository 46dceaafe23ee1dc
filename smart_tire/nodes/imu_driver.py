# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Node ``imu_driver``: reads an IMU and publishes ``imu/data``."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import sys
from typing import Any

from smart_tire.drivers.sample_stream import IMU_PROTOCOLS
from smart_tire.messages import imu_to_msg
from smart_tire.nodes.diagnostics import Status
from smart_tire.nodes.driver import SampleDriver
from smart_tire.nodes.runner import run
from smart_tire.parameters import ImuDriverParams


class ImuDriver(SampleDriver[ImuDriverParams]):
    """
    Publishes IMU samples in REP-103 axes, stamped by the device clock if frames contain it.

    Publishes ``imu/data`` and ``/diagnostics``. Parameters: ``port``, ``baud_rate``,
    ``protocol``, ``latency``, and those of the robot.
    """

    device = 'imu'

    def __init__(self) -> None:
        super().__init__('imu_driver', ImuDriverParams, 'imu/data',
                         lambda params: IMU_PROTOCOLS[params.protocol], _with_noise)

    def fill_status(self, status: Status) -> None:
        """Add protocol and axes."""
        super().fill_status(status)
        status.values.update(
            protocol=self.params.protocol, axes=IMU_PROTOCOLS[self.params.protocol].axes)


def _with_noise(params: ImuDriverParams) -> Callable[[Any, Any], Any]:
    """Return the conversion to messages, with the covariances by the parameters."""
    imu = params.robot.imu
    return partial(imu_to_msg, gyro_noise=imu.gyro_noise, accel_noise=imu.accel_noise)


def main() -> int:
    """Run the node."""
    return run(ImuDriver)


if __name__ == '__main__':
    sys.exit(main())
