"""Simulate without bytes and faster than real time: samples as the drivers would publish them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
import math

import numpy as np

from smart_tire.parameters.simulation import SimulatorParams
from smart_tire.samples import Four, ImuSample, NS_PER_S, Sample, TireSample, WheelSample
from smart_tire.simulation.films import FilmBatch
from smart_tire.simulation.plant import Plant, STEP
from smart_tire.simulation.robot import Observation, Periodic, Robot
from smart_tire.simulation.sensors import encoder_counts, wheel_angles
from smart_tire.simulation.truth import truth_topic

Event = tuple[int, str, Sample]  # receive time [ns], topic, sample
Schedule = Callable[[float], tuple[float, float]] | Sequence[tuple[float, float, float]]

RPM = math.tau / 60.0       # rad/s
EPOCH_NS = 1_700_000_000 * NS_PER_S  # ns, when a simulation starts unless told
IMU_DELAY_NS = 2_000_000    # ns, from the stamp to the reception: a frame at 115200 baud
WHEEL_DELAY_NS = 3_000_000  # ns, likewise: two boards are polled
STAMP_NOISE_NS = 100_000    # ns, one sigma of a batch's stamps after the receiver's clock fit
HOST_STREAM = 1             # random numbers of the host, beside those of the robot
CONTROL_STEPS = 20          # plant steps between two steps of the speed control: 50 Hz
SPEED_RAMP = 20.0           # rad/s2, how fast the set points of the wheel speeds change
KP, KI = 0.1, 0.5           # per rad/s, per rad: duty of the speed control


def simulate(params: SimulatorParams, schedule: Schedule, duration: float, *,
             wheel_rate: float = 16.0, start_ns: int = EPOCH_NS) -> list[Event]:
    """
    Return what nodes would receive in ``duration`` [s], sorted by the time of reception.

    ``schedule`` gives the wheel speeds (left, right) [rpm]: a function of time [s], or a list of
    (time from which, left, right). The events are ``imu/data``, ``wheel_states`` at
    ``wheel_rate`` [Hz], ``tire_samples`` in batches over the lossy radio, and ``ground_truth/*``.
    The same seed gives the same events.
    """
    robot, host = Robot(params), _Host(params, wheel_rate, start_ns)
    control = _SpeedControl(_as_function(schedule), params.drive.free_speed)
    duty: Four = (0.0, 0.0, 0.0, 0.0)
    for step in range(round(duration / STEP)):
        if step % CONTROL_STEPS == 0:
            duty = control.update(robot.plant)
        for observation in robot.step(duty):
            host.receive(observation)
        host.poll_wheels(robot.plant, duty)
    return sorted(host.events, key=lambda event: event[0])


def _as_function(schedule: Schedule) -> Callable[[float], tuple[float, float]]:
    if callable(schedule):
        return schedule
    legs = sorted(schedule)

    def lookup(time: float) -> tuple[float, float]:
        begun = [leg for leg in legs if leg[0] <= time]
        return begun[-1][1:] if begun else (0.0, 0.0)
    return lookup


class _SpeedControl:
    """Holds the wheel speeds of a schedule; the robot's own control loop is a node."""

    def __init__(self, schedule: Callable[[float], tuple[float, float]],
                 free_speed: float) -> None:
        self._schedule, self._free_speed = schedule, free_speed
        self._target = [0.0] * 4    # rad/s
        self._integral = [0.0] * 4  # duty

    def update(self, plant: Plant) -> Four:
        dt = CONTROL_STEPS * STEP
        wanted = self._schedule(plant.time_ns / NS_PER_S) * 2  # left, right, left, right
        fl, fr, rl, rr = (self._hold(i, wanted[i] * RPM, plant.wheel_speed[i], dt)
                          for i in range(4))
        return fl, fr, rl, rr

    def _hold(self, i: int, wanted: float, speed: float, dt: float) -> float:
        reach = SPEED_RAMP * dt
        self._target[i] += min(max(wanted - self._target[i], -reach), reach)
        error = self._target[i] - speed
        grown = self._integral[i] + KI * error * dt
        duty = self._target[i] / self._free_speed + KP * error + grown
        if abs(duty) < 1.0 or error * duty < 0.0:
            self._integral[i] = grown
        return min(max(duty, -1.0), 1.0)


class _Host:
    """Where the drivers would run: keeps what they would publish, and when."""

    def __init__(self, params: SimulatorParams, wheel_rate: float, start_ns: int) -> None:
        self._params, self._start_ns = params, start_ns
        self._rng = np.random.default_rng([params.seed, HOST_STREAM])
        self._wheels_due = Periodic(NS_PER_S / wheel_rate)
        self._reading: tuple[int, Four] | None = None  # stamp and angles of the last reading
        self._radio_ns: dict[str, int] = {}  # when the last packet of a unit came
        self.events: list[Event] = []

    def receive(self, seen: Observation) -> None:
        """Take what a device has sent."""
        if isinstance(seen, FilmBatch):
            self._receive_batch(seen)
            return
        told = replace(seen, stamp_ns=self._start_ns + seen.stamp_ns)
        if isinstance(seen, ImuSample):
            self.events.append((told.stamp_ns + IMU_DELAY_NS, 'imu/data', told))
        else:
            self.events.append((told.stamp_ns, truth_topic(seen), told))

    def poll_wheels(self, plant: Plant, duty: Four) -> None:
        """Read the encoders when it is time."""
        if not self._wheels_due.passed(plant.time_ns):
            return
        encoder, now_ns = self._params.robot.encoder, self._start_ns + plant.time_ns
        error = encoder.latency + self._rng.normal(0.0, encoder.stamp_jitter)
        stamp_ns = now_ns + round(error * NS_PER_S)
        counts = encoder_counts(plant, encoder.counts_per_revolution)
        angles = wheel_angles(counts, encoder.counts_per_revolution)
        last, self._reading = self._reading, (stamp_ns, angles)
        if last is None or stamp_ns <= last[0]:
            return
        dt = (stamp_ns - last[0]) / NS_PER_S
        fl, fr, rl, rr = ((new - old) / dt for new, old in zip(angles, last[1]))
        self.events.append((now_ns + WHEEL_DELAY_NS, 'wheel_states',
                            WheelSample(stamp_ns, (fl, fr, rl, rr), angles, duty)))

    def _receive_batch(self, batch: FilmBatch) -> None:
        """Take a batch from the radio: late, in order, or lost."""
        radio, film = self._params.radio, self._params.robot.film
        delay = min(radio.delay + self._rng.exponential(radio.jitter), radio.longest)
        lost = self._rng.random() < radio.loss
        stamp_error_ns = round(self._rng.normal(0.0, STAMP_NOISE_NS))
        if lost:
            return
        sent_ns = self._start_ns + batch.trace.stamps_ns[-1]
        receive_ns = max(sent_ns + round(delay * NS_PER_S), self._radio_ns.get(batch.wheel, 0))
        self._radio_ns[batch.wheel] = receive_ns
        scale = film.voltage_range / ((1 << film.bits) - 1)
        for stamp_ns, codes in zip(batch.trace.stamps_ns, batch.codes):
            volts = tuple(code * scale for code in codes)
            stamp_ns += self._start_ns + stamp_error_ns
            self.events.append((receive_ns, 'tire_samples',
                                TireSample(stamp_ns, batch.wheel, volts)))
