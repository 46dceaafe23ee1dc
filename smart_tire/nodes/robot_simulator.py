# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Node ``robot_simulator``: device emulators on pseudo-terminals, and ground-truth topics."""

from __future__ import annotations

import sys
import threading
import time

from rclpy.time import Time
from rosgraph_msgs.msg import Clock

from smart_tire.drivers.clock import SYSTEM
from smart_tire.errors import LinkError, ParameterError
from smart_tire.host_load import FACTOR, GIVEN_UP, WAITED_FOR
from smart_tire.messages import TOPICS
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.diagnostics import Status
from smart_tire.nodes.runner import run
from smart_tire.parameters import SimulatorParams
from smart_tire.samples import NS_PER_S
from smart_tire.simulation.realtime import SimulatedHardware
from smart_tire.simulation.time_keeper import TimeKeeper
from smart_tire.simulation.truth import Truth, truth_topic

THREAD_TIMEOUT = 5.0       # s for the thread of the simulation to end
PORT_CLOSE_TIMEOUT = 2.0   # s for the drivers to close the ports; launch waits 5 s in total
PORT_POLL_PERIOD = 0.02    # s
CLOCK_PERIOD = 0.02        # s between messages on /clock
CLOCK_DEPTH = 1            # queued ones: only the latest counts


class RobotSimulator(SmartTireNode[SimulatorParams]):
    """
    Simulated robot in real time.

    It uses the system clock, as hardware does, whatever ``use_sim_time`` is, unless
    ``SMART_TIRE_CLOCK`` names a time that it shares with its nodes: this passes slower where they
    cannot keep up, and is published on ``/clock``. A separate thread answers the requests to the
    motor boards, independent of the executor.

    Publishes ``ground_truth/odom``, ``ground_truth/wheel_slip``, ``ground_truth/tire_friction``
    and ``/diagnostics``. Parameters: ``seed``, ``start``, ``imu_rate``, ``units``, ``protocol``,
    ``addresses``, ``truth_log``, ``ground.*``, ``drive.*``, ``radio.*``, ``errors.*``,
    ``ports.*``, and those of the robot.
    """

    def __init__(self) -> None:
        super().__init__('robot_simulator', SimulatorParams)
        self._publish = {name: self.make_publisher(name)
                         for name in TOPICS if name.startswith('ground_truth/')}
        try:
            self._hardware = SimulatedHardware(
                self.params, self._publish_truth, SYSTEM.time_ns(), self.get_namespace())
        except LinkError as error:
            raise ParameterError(f'ports or truth_log: {error}') from error
        self._stopping = threading.Event()
        self._keeper = None if SYSTEM.simulated is None else TimeKeeper(
            SYSTEM.simulated, self.get_name())
        if self._keeper is not None:
            self._clock = self.create_publisher(Clock, '/clock', CLOCK_DEPTH)
            self.call_every(CLOCK_PERIOD, self._publish_clock)
        self._reported_ns = 0, 0  # real and simulated time of the latest status
        self._thread = threading.Thread(target=self._hardware.run, name='hardware', daemon=True,
                                        args=(SYSTEM.time_ns, self._stopping, self._keeper))

    def start(self) -> None:
        """Start the simulation."""
        self._thread.start()

    def stop(self) -> None:
        """
        Remove the ports, after the drivers have closed them.

        Ctrl-C ends drivers and simulator at the same time; a real device does not disappear
        before its driver.
        """
        end = time.monotonic() + PORT_CLOSE_TIMEOUT
        while self._thread.is_alive() and self._hardware.in_use and time.monotonic() < end:
            time.sleep(PORT_POLL_PERIOD)
        self._stopping.set()
        self._thread.join(THREAD_TIMEOUT)
        self._hardware.close()
        if self._keeper is not None:
            self._keeper.close()

    def _publish_clock(self) -> None:
        self._clock.publish(Clock(clock=Time(nanoseconds=self.now_ns()).to_msg()))

    def _publish_truth(self, truth: Truth) -> None:
        self._publish[truth_topic(truth)](truth)

    def fill_status(self, status: Status) -> None:
        """Add the losses of the simulated links, and an error if the simulation has ended."""
        dropped = self._hardware.dropped
        status.values['batches_dropped'] = sum(dropped.values())
        status.values.update({f'{wheel}.batches_dropped': count
                              for wheel, count in dropped.items()})
        status.values['frames_bad'] = self._hardware.bad_requests
        status.values['bytes_not_taken'] = self._hardware.lost_bytes
        status.values['clock_jumps'] = self._hardware.clock_jumps
        if self._keeper is not None:
            self._fill_time(status, self._keeper)
        if not self._thread.is_alive():
            status.error('the simulation has stopped')

    def _fill_time(self, status: Status, keeper: TimeKeeper) -> None:
        """Add how fast simulated time passes, and the participants for which it has stood."""
        (real_ns, simulated_ns), self._reported_ns = self._reported_ns, keeper.readings()
        if real_ns:
            status.values[FACTOR] = (self._reported_ns[1] - simulated_ns) / max(
                self._reported_ns[0] - real_ns, 1)
        status.values.update({f'{WAITED_FOR}{name}': waited_ns / NS_PER_S
                              for name, waited_ns in keeper.waited_ns.items()})
        for name, count in keeper.given_up.items():
            status.values[f'{GIVEN_UP}{name}'] = count
            if new := status.new(f'time of {name}', count):
                status.warn(f'simulated time passed without {name}, {new} x')


def main() -> int:
    """Run the node."""
    return run(RobotSimulator)


if __name__ == '__main__':
    sys.exit(main())
