"""Simulate without bytes and faster than real time: samples as the drivers would publish them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
import math

import numpy as np

from smart_tire.parameters.simulation import SimulatorParams
from smart_tire.samples import Four, ImuSample, NS_PER_S, Sample, TireSample, WheelSample
from smart_tire.simulation.films import FilmBatch, WheelUnit
from smart_tire.simulation.plant import Plant, STEP
from smart_tire.simulation.sensors import encoder_counts, InertialUnit, wheel_angles
from smart_tire.simulation.surfaces import Ground
from smart_tire.simulation.truth import PassageTruth, true_odometry, true_slip

Event = tuple[int, str, Sample]  # receive time [ns], topic, sample
Schedule = Callable[[float], tuple[float, float]] | Sequence[tuple[float, float, float]]

RPM = math.tau / 60.0       # rad/s
TRUTH_NS = 10_000_000       # ns, period of the ground truth
EPOCH_NS = 1_700_000_000 * NS_PER_S  # ns, when a simulation starts unless told
IMU_DELAY_NS = 2_000_000    # ns, from the stamp to the reception: a frame at 115200 baud
WHEEL_DELAY_NS = 3_000_000  # ns, likewise: two boards are polled
STAMP_NOISE_NS = 100_000    # ns, one sigma of a batch's stamps after the receiver's clock fit
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
    run = _Run(params, wheel_rate, start_ns)
    control = _SpeedControl(_as_function(schedule), params.drive.free_speed)
    duty: Four = (0.0, 0.0, 0.0, 0.0)
    for step in range(round(duration / STEP)):
        if step % CONTROL_STEPS == 0:
            duty = control.update(run.plant)
        run.plant.step(duty)
        run.read(duty)
    run.events.sort(key=lambda event: event[0])
    return run.events


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


class _Run:
    """The plant with its sensors, and the events so far."""

    def __init__(self, params: SimulatorParams, wheel_rate: float, start_ns: int) -> None:
        robot = params.robot
        seeds = np.random.SeedSequence(params.seed).spawn(2 + len(robot.film.wheels))
        self._rng, imu_rng, *unit_rngs = map(np.random.default_rng, seeds)
        self._params, self._start_ns = params, start_ns
        self.plant = Plant(robot, params.drive, Ground(params.ground), params.start)
        self._imu = InertialUnit(robot, params.errors, imu_rng)
        self._units = [WheelUnit(wheel, params, rng)
                       for wheel, rng in zip(robot.film.wheels, unit_rngs)]
        self._truths = [PassageTruth(unit, robot) for unit in self._units]
        self._imu_due = Periodic(NS_PER_S / params.imu_rate)
        self._wheels_due = Periodic(NS_PER_S / wheel_rate)
        self._truth_due = Periodic(TRUTH_NS)
        self._reading: tuple[int, Four] | None = None  # stamp and angles of the last reading
        self._radio_ns = [0] * len(self._units)  # when the last packet of a unit came
        self.events: list[Event] = []

    def read(self, duty: Four) -> None:
        """Let every sensor that is due look at the plant."""
        plant, now_ns = self.plant, self._start_ns + self.plant.time_ns
        if self._imu_due.passed(plant.time_ns):
            self._add(now_ns + IMU_DELAY_NS, 'imu/data', ImuSample(now_ns, *self._imu.read(plant)))
        if self._wheels_due.passed(plant.time_ns):
            self._read_wheels(now_ns, duty)
        if self._truth_due.passed(plant.time_ns):
            self._add(now_ns, 'ground_truth/odom', true_odometry(plant, now_ns))
            self._add(now_ns, 'ground_truth/wheel_slip',
                      true_slip(plant, self._params.robot, now_ns))
        for i, unit in enumerate(self._units):
            if unit.due_ns <= plant.time_ns:
                for batch in unit.observe(plant):
                    self._send(i, batch)
                    self._tell_passages(i, batch)

    def _add(self, receive_ns: int, topic: str, sample: Sample) -> None:
        self.events.append((receive_ns, topic, sample))

    def _read_wheels(self, now_ns: int, duty: Four) -> None:
        encoder = self._params.robot.encoder
        error = encoder.latency + self._rng.normal(0.0, encoder.stamp_jitter)
        stamp_ns = now_ns + round(error * NS_PER_S)
        counts = encoder_counts(self.plant, encoder.counts_per_revolution)
        angles = wheel_angles(counts, encoder.counts_per_revolution)
        last, self._reading = self._reading, (stamp_ns, angles)
        if last is None or stamp_ns <= last[0]:
            return
        dt = (stamp_ns - last[0]) / NS_PER_S
        fl, fr, rl, rr = ((new - old) / dt for new, old in zip(angles, last[1]))
        self._add(now_ns + WHEEL_DELAY_NS, 'wheel_states',
                  WheelSample(stamp_ns, (fl, fr, rl, rr), angles, duty))

    def _send(self, i: int, batch: FilmBatch) -> None:
        """Put a batch on the radio: late, in order, or lost."""
        radio, film = self._params.radio, self._params.robot.film
        delay = radio.delay + self._rng.exponential(radio.jitter)
        lost = self._rng.random() < radio.loss
        error_ns = round(self._rng.normal(0.0, STAMP_NOISE_NS))
        if lost:
            return
        last_ns = self._start_ns + batch.trace.stamps_ns[-1]
        receive_ns = max(last_ns + round(delay * NS_PER_S), self._radio_ns[i])
        self._radio_ns[i] = receive_ns
        scale = film.voltage_range / ((1 << film.bits) - 1)
        for stamp_ns, codes in zip(batch.trace.stamps_ns, batch.codes):
            volts = tuple(code * scale for code in codes)
            self._add(receive_ns, 'tire_samples',
                      TireSample(self._start_ns + stamp_ns + error_ns, batch.wheel, volts))

    def _tell_passages(self, i: int, batch: FilmBatch) -> None:
        for passage in self._truths[i].update(batch.trace):
            told = replace(passage, stamp_ns=self._start_ns + passage.stamp_ns)
            self._add(self._start_ns + self.plant.time_ns, 'ground_truth/tire_friction', told)


class Periodic:
    """Tells when a period [ns] has passed, without drift."""

    def __init__(self, period_ns: float) -> None:
        self._period_ns, self._count = period_ns, 1

    def passed(self, time_ns: int) -> bool:
        """Return whether the next instant of the grid has come."""
        if time_ns < self._count * self._period_ns:
            return False
        self._count += 1
        return True
