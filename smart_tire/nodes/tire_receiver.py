# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Node ``tire_receiver``: batches of the sensor nodes to ``tire_samples``."""

from __future__ import annotations

import sys
import threading
from typing import Any

from smart_tire.drivers.clock import SYSTEM
from smart_tire.drivers.pacing import PacedSender
from smart_tire.drivers.serial_port import read_loop
from smart_tire.drivers.tire_receiver import TireStream
from smart_tire.nodes.base import MAX_INPUT_AGE
from smart_tire.nodes.diagnostics import Status
from smart_tire.nodes.driver import DriverNode, nanoseconds
from smart_tire.nodes.runner import run
from smart_tire.parameters import TireReceiverParams
from smart_tire.samples import BatterySample, NS_PER_S


class TireReceiver(DriverNode[TireReceiverParams]):
    """
    Publishes one message per A/D conversion, stamped by the timer of the sensor node.

    Publishes ``tire_samples`` (batches on ``tire_samples/typed`` if smart_tire_msgs is
    installed), ``tire_battery`` and ``/diagnostics``. Parameters: ``port``,
    ``baud_rate``, ``units``, ``radio_latency``, and those of the robot.
    """

    device = 'tire_radio'

    def __init__(self) -> None:
        super().__init__('tire_receiver', TireReceiverParams)
        wheel_of = self.params.wheel_of()
        self._stream = TireStream(wheel_of, nanoseconds(self.params.radio_latency))
        self._sender = PacedSender(
            self.make_publisher('tire_samples', wheels=len(wheel_of)), len(wheel_of))
        self._publish_batch = self.make_typed_publisher('tire_samples', wheels=len(wheel_of))
        self._publish_battery = self.make_publisher('tire_battery', wheels=len(wheel_of))
        self.connect(self._stream, self._read_port)

    def start(self) -> None:
        """Start the publishing thread and open the port."""
        self._sender.start()
        super().start()

    def stop(self) -> None:
        """Close the port, then publish the samples that wait."""
        super().stop()
        self._sender.stop()

    def _read_port(self, port: Any, stopping: threading.Event) -> None:
        read_loop(port, stopping, self._on_bytes)

    def _on_bytes(self, chunk: bytes, receive_ns: int) -> None:
        for item in self._stream.receive(chunk, receive_ns):
            if isinstance(item, BatterySample):
                self._publish_battery(item)
            else:
                self._sender.put(item.samples)
                self._publish_batch(item)

    def fill_status(self, status: Status) -> None:
        """Add counts of batches and the clock of each sensor node."""
        super().fill_status(status)
        sensor_nodes = self._stream.sensor_nodes.values()
        status.values.update(
            batches_ok=sum(node.batches for node in sensor_nodes),
            batches_lost=sum(node.lost for node in sensor_nodes),
            batches_duplicate=sum(node.duplicates for node in sensor_nodes),
            batches_late=sum(node.late for node in sensor_nodes),
            batches_saturated=sum(node.saturated for node in sensor_nodes),
            sensor_node_resets=sum(node.resets for node in sensor_nodes),
            pacing_overruns=self._sender.overruns)
        for node in sensor_nodes:
            status.values.update({
                f'{node.wheel}.batches_ok': node.batches,
                f'{node.wheel}.batches_lost': node.lost,
                f'{node.wheel}.timer_drift_ppm': node.clock.drift * 1e6,
                f'{node.wheel}.radio_jitter': node.clock.jitter})
            if SYSTEM.time_ns() - node.last_ns > MAX_INPUT_AGE * NS_PER_S:
                status.warn(f'no batches from {node.wheel}')


def main() -> int:
    """Run the node."""
    return run(TireReceiver)


if __name__ == '__main__':
    sys.exit(main())
