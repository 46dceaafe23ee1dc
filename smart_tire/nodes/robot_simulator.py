"""Be the robot: its devices on pseudo-terminals, and the ground truth that no robot has."""

from __future__ import annotations

import sys
import threading
import time

from smart_tire.errors import LinkError, ParameterError
from smart_tire.messages import TOPICS
from smart_tire.nodes.base import run, SmartTireNode
from smart_tire.nodes.diagnostics import Status
from smart_tire.parameters import SimulatorParams
from smart_tire.simulation.realtime import SimulatedHardware
from smart_tire.simulation.truth import Truth, truth_topic

STOP_TIMEOUT = 5.0   # s
HOST_PATIENCE = 2.0  # s that drivers may take to close the ports; launch waits 5 s in all
HOST_POLL = 0.02     # s


class RobotSimulator(SmartTireNode[SimulatorParams]):
    """
    The simulated robot in real time.

    It always goes by the system's clock, as hardware does, whatever ``use_sim_time`` says. A
    thread of its own answers the motor boards' requests without waiting for the executor.
    """

    def __init__(self) -> None:
        super().__init__('robot_simulator', SimulatorParams)
        wheels = len(self.params.robot.film.wheels)
        self._publish = {name: self.advertise(name, wheels=wheels)
                         for name in TOPICS if name.startswith('ground_truth/')}
        try:
            self._hardware = SimulatedHardware(self.params, self._tell, time.time_ns())
        except LinkError as error:
            raise ParameterError(f'ports or truth_log: {error}') from error
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._hardware.run, name='hardware', daemon=True,
                                        args=(time.time_ns, self._stopping))

    def start(self) -> None:
        """Begin to move with the time."""
        self._thread.start()

    def stop(self) -> None:
        """
        Take the ports away, after the drivers have closed them.

        Ctrl-C ends both at the same time, and a device does not vanish before its driver.
        """
        end = time.monotonic() + HOST_PATIENCE
        while self._thread.is_alive() and self._hardware.in_use and time.monotonic() < end:
            time.sleep(HOST_POLL)
        self._stopping.set()
        self._thread.join(STOP_TIMEOUT)
        self._hardware.close()

    def _tell(self, truth: Truth) -> None:
        self._publish[truth_topic(truth)](truth)

    def fill_status(self, status: Status) -> None:
        """Add what the simulated radio has lost, and whether the robot still moves."""
        dropped = self._hardware.dropped
        status.values['batches_dropped'] = sum(dropped.values())
        status.values.update({f'{wheel}.batches_dropped': count
                              for wheel, count in dropped.items()})
        status.values['frames_bad'] = self._hardware.bad_requests
        status.values['bytes_not_taken'] = self._hardware.lost_bytes
        status.values['clock_jumps'] = self._hardware.clock_jumps
        if not self._thread.is_alive():
            status.error('the simulation has stopped')


def main() -> int:
    """Run the node."""
    return run(RobotSimulator)


if __name__ == '__main__':
    sys.exit(main())
