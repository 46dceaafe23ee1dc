"""Read the inertial unit and publish ``imu/data``."""

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
    """Frames in, samples in REP-103 axes out, stamped by the unit's clock if it tells one."""

    def __init__(self) -> None:
        super().__init__('imu_driver', ImuDriverParams)
        self._stream = ImuStream(self.params.protocol, nanoseconds(self.params.latency))
        self._publish = self.advertise('imu/data')
        self.connect(self._stream, self._work)

    def _work(self, port: Any, stopping: threading.Event) -> None:
        self._stream.reset_clocks()
        read_loop(port, stopping, self._on_bytes)

    def _on_bytes(self, chunk: bytes, receive_ns: int) -> None:
        for sample in self._stream.feed(chunk, receive_ns):
            self._publish(sample)

    def fill_status(self, status: Status) -> None:
        """Add where axes and stamps come from."""
        super().fill_status(status)
        status.values.update(
            protocol=self.params.protocol, axes=self._stream.protocol.axes,
            stamps=self._stream.timestamp_source)


def main() -> int:
    """Run the node."""
    return run(ImuDriver)


if __name__ == '__main__':
    sys.exit(main())
