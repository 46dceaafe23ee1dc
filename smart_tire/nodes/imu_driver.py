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

"""Node ``imu_driver``: reads an IMU and publishes ``imu/data``."""

from __future__ import annotations

import sys
import threading
from typing import Any

from smart_tire.drivers.imu_receiver import ImuStream
from smart_tire.drivers.serial_port import read_loop
from smart_tire.nodes.base import run
from smart_tire.nodes.diagnostics import Status
from smart_tire.nodes.driver import DriverNode, nanoseconds
from smart_tire.parameters import ImuDriverParams


class ImuDriver(DriverNode[ImuDriverParams]):
    """
    Publishes IMU samples in REP-103 axes, stamped by the device clock if frames contain it.

    Publishes ``imu/data`` and ``/diagnostics``. Parameters: ``port``, ``baud_rate``,
    ``protocol``, ``latency``, and those of the robot.
    """

    def __init__(self) -> None:
        super().__init__('imu_driver', ImuDriverParams)
        self._stream = ImuStream(self.params.protocol, nanoseconds(self.params.latency))
        self._publish = self.make_publisher('imu/data')
        self.connect(self._stream, self._read_port)

    def _read_port(self, port: Any, stopping: threading.Event) -> None:
        self._stream.reset_clocks()
        read_loop(port, stopping, self._on_bytes)

    def _on_bytes(self, chunk: bytes, receive_ns: int) -> None:
        for sample in self._stream.receive(chunk, receive_ns):
            self._publish(sample)

    def fill_status(self, status: Status) -> None:
        """Add protocol, axes and the source of timestamps."""
        super().fill_status(status)
        status.values.update(
            protocol=self.params.protocol, axes=self._stream.protocol.axes,
            stamps=self._stream.timestamp_source)


def main() -> int:
    """Run the node."""
    return run(ImuDriver)


if __name__ == '__main__':
    sys.exit(main())
