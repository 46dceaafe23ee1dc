# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Simulated hardware in real time: the device emulators on pseudo-terminals."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
import math
import threading
from typing import TextIO

import numpy as np

from smart_tire.errors import LinkError, ParameterError
from smart_tire.parameters.simulation import SimulatorParams
from smart_tire.paths import port_url, SIMULATED
from smart_tire.protocol import tire_payload
from smart_tire.samples import ImuSample, NS_PER_S
from smart_tire.simulation.device_emulators import ImuEmulator, RadioEmulator, RoboclawEmulator
from smart_tire.simulation.films import FilmBatch
from smart_tire.simulation.plant import STEP_NS, TIME_STEP
from smart_tire.simulation.pseudo_terminal import PtyPort
from smart_tire.simulation.robot import encoder_counts, Observation, Robot
from smart_tire.simulation.time_keeper import TimeKeeper
from smart_tire.simulation.truth import Truth

DEVICE_RNG_STREAM = 2        # index of the random stream of the devices
MAX_ADVANCE_NS = 50_000_000  # maximum simulated time per call, and maximum wait
MAX_LAG_NS = 5 * NS_PER_S    # lag of the plant beyond which the host clock was set forward
MAX_LEAD_NS = 500_000_000    # lead of the plant beyond which the host clock was set back


class SimulatedHardware:
    """
    Robot, radio, IMU and motor boards on pseudo-terminals, until ``close``.

    All external times are host times [ns]; the plant starts at ``host_ns``. ``publish`` is called
    with the ground truth. Ports ``simulated:NAME`` are those of ``namespace``. A step of the host
    clock does not affect the robot.
    """

    def __init__(self, params: SimulatorParams, publish: Callable[[Truth], None],
                 host_ns: int, namespace: str = '') -> None:
        _check_payload(params)
        self.clock_jumps = 0
        self._robot = Robot(params)
        self._publish, self._epoch_ns = publish, host_ns
        self._counts_per_revolution = params.robot.encoder.counts_per_revolution
        rng, radio = np.random.default_rng([params.seed, DEVICE_RNG_STREAM]), params.radio
        self._imu = ImuEmulator(params.protocol,
                                clock_error=rng.normal(0.0, params.errors.imu_clock))
        self._boards = RoboclawEmulator(params.addresses)
        self._radio = RadioEmulator(self._robot.sensor_nodes, rng, delay=radio.delay,
                                    jitter=radio.jitter, max_delay=radio.max_delay,
                                    loss=radio.loss)
        self._open(params, namespace)

    def _open(self, params: SimulatorParams, namespace: str) -> None:
        with ExitStack() as opened:
            self._imu_port, self._radio_port, self._motor_port = (
                opened.enter_context(PtyPort(port_url(link, namespace).removeprefix(SIMULATED)))
                for link in (params.ports.imu, params.ports.tire_radio, params.ports.motors))
            self._log: TextIO | None = None
            if params.truth_log:
                self._log = opened.enter_context(_create(params.truth_log))
                self._log.write('wheel,sequence,dropped,stamps_ns\n')
            self._opened = opened.pop_all()

    def close(self) -> None:
        """Close all ports and the log."""
        self._opened.close()

    @property
    def in_use(self) -> bool:
        """Return whether a host has one of the ports open."""
        return any(port.connected for port in self._ports())

    @property
    def dropped(self) -> dict[str, int]:
        """Return the number of batches of each wheel lost by the radio."""
        return self._radio.dropped

    @property
    def bad_requests(self) -> int:
        """Return the number of damaged requests to the motor boards."""
        return self._boards.bad_frames

    @property
    def lost_bytes(self) -> int:
        """Return the number of bytes sent to the ports but not received by a host."""
        return sum(port.lost_bytes for port in self._ports())

    def _ports(self) -> tuple[PtyPort, PtyPort, PtyPort]:
        return self._imu_port, self._radio_port, self._motor_port

    def run(self, clock: Callable[[], int], stopping: threading.Event,
            keeper: TimeKeeper | None = None) -> None:
        """Follow the host ``clock`` [ns], which ``keeper`` sets, until ``stopping`` is set."""
        if keeper is not None:
            for name, port in zip(('imu_driver', 'tire_receiver'), self._ports()):
                keeper.await_reader(name, port)
        while not stopping.is_set():
            next_ns = self.advance(clock())
            self._motor_port.wait(max(next_ns - clock(), 0) / NS_PER_S if keeper is None
                                  else keeper.wait_time(next_ns))

    def advance(self, host_ns: int) -> int:
        """Advance the simulation to ``host_ns``; return the host time of the next event."""
        now_ns = self._true_time(host_ns)
        plant, end_ns = self._robot.plant, min(now_ns, self._robot.plant.time_ns + MAX_ADVANCE_NS)
        while plant.time_ns + STEP_NS <= end_ns:
            for observation in self._robot.step(self._boards.duty(plant.time_ns)):
                self._deliver(observation)
        if packets := self._radio.due(now_ns):
            self._radio_port.write(packets)
        if requests := self._motor_port.read():
            self._motor_port.write(self._reply(requests, now_ns))
        arrival_ns = self._radio.next_ns()
        next_ns = self._robot.next_ns if arrival_ns is None else min(
            self._robot.next_ns, arrival_ns)
        return self._epoch_ns + min(next_ns, now_ns + MAX_ADVANCE_NS)

    def _true_time(self, host_ns: int) -> int:
        """Return the time since the start of the plant, compensated for host clock steps."""
        behind_ns = host_ns - self._epoch_ns - self._robot.plant.time_ns
        if not -MAX_LEAD_NS < behind_ns < MAX_LAG_NS:
            self._epoch_ns += behind_ns
            self.clock_jumps += 1
        return host_ns - self._epoch_ns

    def _deliver(self, item: Observation) -> None:
        if isinstance(item, FilmBatch):
            stamps_ns, before = item.trace.stamps_ns, self._radio.dropped[item.wheel]
            sequence = self._radio.send(item.wheel, item.first, item.codes, stamps_ns[-1])
            if self._log:
                stamps = ' '.join(str(self._epoch_ns + stamp_ns) for stamp_ns in stamps_ns)
                dropped = self._radio.dropped[item.wheel] - before
                self._log.write(f'{item.wheel},{sequence},{dropped},{stamps}\n')
        elif isinstance(item, ImuSample):
            self._imu_port.write(self._imu.frame(item))
        else:
            self._publish(replace(item, stamp_ns=self._epoch_ns + item.stamp_ns))

    def _reply(self, requests: bytes, now_ns: int) -> bytes:
        plant = self._robot.plant
        ahead = min((now_ns - plant.time_ns) / NS_PER_S, TIME_STEP)
        counts = encoder_counts(plant, self._counts_per_revolution, ahead)
        motors = self._robot.motors
        currents = motors.reported(motors.currents(plant), self._boards.duty(now_ns))
        scale = self._counts_per_revolution / math.tau
        return self._boards.replies(requests, now_ns, counts, currents,
                                    [scale * speed for speed in plant.wheel_speed])


def _check_payload(params: SimulatorParams) -> None:
    film = params.robot.film
    if (film.bits, film.voltage_range) != (10, tire_payload.FULL_SCALE):
        raise ParameterError(f'film.bits {film.bits} and film.voltage_range '
                             f'{film.voltage_range:g} V: the payload of the sensor nodes has '
                             f'10 bits and {tire_payload.FULL_SCALE:g} V full scale')


def _create(path: str) -> TextIO:
    try:
        return open(path, 'w', encoding='utf-8')
    except OSError as error:
        raise LinkError(f'truth_log: cannot write {path}: {error.strerror}') from error
