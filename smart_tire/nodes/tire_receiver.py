"""Receive the wheel units' batches from the XBee coordinator and publish ``tire_samples``."""

from __future__ import annotations

import sys
import threading
import time
from typing import Any

from smart_tire.drivers.pacing import PacedSender
from smart_tire.drivers.serial_port import read_loop
from smart_tire.drivers.tire_receiver import TireStream
from smart_tire.nodes.base import run, SILENCE
from smart_tire.nodes.diagnostics import Status
from smart_tire.nodes.driver import DriverNode, nanoseconds
from smart_tire.parameters import TireReceiverParams
from smart_tire.samples import BatterySample, NS_PER_S


class TireReceiver(DriverNode[TireReceiverParams]):
    """Radio bytes in, one message per conversion out, stamped by the unit's own timer."""

    def __init__(self) -> None:
        super().__init__('tire_receiver', TireReceiverParams)
        wheel_of = self.params.wheel_of()
        self._stream = TireStream(wheel_of, nanoseconds(self.params.radio_latency))
        self._sender = PacedSender(
            self.advertise('tire_samples', wheels=len(wheel_of)), len(wheel_of))
        self._publish_battery = self.advertise('tire_battery', wheels=len(wheel_of))
        self.connect(self._stream, self._work)

    def start(self) -> None:
        """Begin to open the port and to send what comes."""
        self._sender.start()
        super().start()

    def stop(self) -> None:
        """Close the port, then send what came before."""
        super().stop()
        self._sender.stop()

    def _work(self, port: Any, stopping: threading.Event) -> None:
        read_loop(port, stopping, self._on_bytes)

    def _on_bytes(self, chunk: bytes, receive_ns: int) -> None:
        for item in self._stream.feed(chunk, receive_ns):
            if isinstance(item, BatterySample):
                self._publish_battery(item)
            else:
                self._sender.put(item)

    def fill_status(self, status: Status) -> None:
        """Add what was lost on the way from each unit."""
        super().fill_status(status)
        units = self._stream.sensor_nodes.values()
        status.values.update(
            batches_ok=sum(unit.batches for unit in units),
            batches_lost=sum(unit.lost for unit in units),
            batches_duplicate=sum(unit.duplicates for unit in units),
            batches_late=sum(unit.late for unit in units),
            batches_saturated=sum(unit.saturated for unit in units),
            unit_resets=sum(unit.resets for unit in units),
            pacing_overruns=self._sender.overruns)
        for unit in units:
            status.values.update({
                f'{unit.wheel}.batches_ok': unit.batches,
                f'{unit.wheel}.batches_lost': unit.lost,
                f'{unit.wheel}.timer_drift_ppm': unit.clock.drift * 1e6,
                f'{unit.wheel}.radio_jitter': unit.clock.jitter})
            if time.time_ns() - unit.last_ns > SILENCE * NS_PER_S:
                status.warn(f'nothing from {unit.wheel}')


def main() -> int:
    """Run the node."""
    return run(TireReceiver)


if __name__ == '__main__':
    sys.exit(main())
