"""
Passages of all instrumented wheels of a recording, and what is known of the slip in each.

Passages are found first; slips, of an estimator that has gone over the whole recording, come
after. What the films tell of slip has no part in it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
import math

from smart_tire.estimation.contact.records import CrossingSamples, PatchCrossing
from smart_tire.estimation.contact.tracker import ContactTracker
from smart_tire.estimation.friction.estimator import BLOCK_NS, TOPICS
from smart_tire.estimation.friction.motion_history import MotionHistory, ValueSigma
from smart_tire.estimation.friction.waveform_method import (
    CHANGE_ERROR, CHANGE_NOISE, SPEED_NOISE, TRANSIENT, UNSEEN)
from smart_tire.estimation.reorder_buffer import ReorderBuffer
from smart_tire.parameters import RobotParams
from smart_tire.samples import (
    MAX_WHEEL_SPEED, NS_PER_S, TireSample, WHEELS, WheelSample, WheelSlip)

AFTER_NS = 500_000_000  # of slips behind a passage, from which its mean and slope are taken


@dataclass(frozen=True, slots=True)
class CrossingWithSlip:
    """A passage whose films were seen, and the slip in it."""

    wheel: str
    stamp_ns: int
    direction: int     # +1 forward, -1 backward
    speed: float       # m/s, r |omega|
    films: CrossingSamples
    slip: ValueSigma     # -, B(3)'s lambda at the reference
    stray: float       # -, by which it may stray from a straight line in this passage
    change: ValueSigma   # -, of the slip over a contact length
    origin: float      # rad, ``wheel_states.position`` where distances are 0; NaN without


@dataclass(frozen=True, slots=True)
class _Found:
    wheel: str
    passage: PatchCrossing
    origin: float


@dataclass
class _Wheel:
    """The films of one wheel, group by group."""

    films: list[ContactTracker]
    origin: float = math.nan
    begun: bool = False
    newest_ns: int = 0


@dataclass
class PassageCollector:
    """Collects the passages of ``robot`` from samples in the order of reception."""

    robot: RobotParams
    reorder_window: float  # s
    tire_samples: int = 0  # of instrumented wheels
    passages: int = 0      # found, seen or not
    _found: list[_Found] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._gate = ReorderBuffer(round(self.reorder_window * NS_PER_S))
        self._resets = 0
        self._start()

    def _start(self) -> None:
        self._wheels_ns = 0
        self._wheels = {wheel: _Wheel([ContactTracker(wheel, self.robot, group)
                                       for group in self.robot.film_groups])
                        for wheel in self.robot.film.wheels}

    def update(self, sample: TireSample | WheelSample) -> None:
        """Take in a sample."""
        closed = self._gate.push(TOPICS[type(sample)], sample.stamp_ns, sample)
        if self._gate.resets != self._resets:
            self._resets = self._gate.resets
            self._start()
        for instant, samples in closed:
            for item in samples:
                self._take(item)
            if instant % BLOCK_NS == 0:
                self._advance(instant)

    def _take(self, sample: TireSample | WheelSample) -> None:
        if isinstance(sample, WheelSample):
            if sample.stamp_ns > self._wheels_ns and all(
                    abs(speed) <= MAX_WHEEL_SPEED for speed in sample.velocity):
                self._wheels_ns = sample.stamp_ns
                self._add_wheels(sample)
            return
        wheel = self._wheels.get(sample.wheel)
        if wheel is not None and sample.stamp_ns > wheel.newest_ns and all(
                map(math.isfinite, sample.volts)):
            wheel.newest_ns = sample.stamp_ns
            self.tire_samples += 1
            for films in wheel.films:
                films.add_films(sample)

    def _add_wheels(self, sample: WheelSample) -> None:
        for name, wheel in self._wheels.items():
            if sample.position is None:  # distances go on by speed, positions may not
                wheel.origin = math.nan
            elif not wheel.begun:
                wheel.origin = sample.position[WHEELS.index(name)]
            wheel.begun = True
            for films in wheel.films:
                films.add_wheels(sample)

    def _advance(self, instant: int) -> None:
        for name, wheel in self._wheels.items():
            for films in wheel.films:
                for passage in films.advance(instant):
                    self.passages += 1
                    if passage.samples is not None:
                        self._found.append(_Found(name, passage, wheel.origin))

    def known(self, slips: Iterable[WheelSlip]) -> Iterator[CrossingWithSlip]:
        """Yield the passages whose slip is among ``slips``, which come in the order of stamps."""
        waiting = sorted(self._found, key=lambda found: found.passage.end_ns, reverse=True)
        motion = MotionHistory(self.robot, 0.0)
        for slip in slips:
            motion.add_slip(slip)
            while waiting and waiting[-1].passage.end_ns + AFTER_NS < slip.stamp_ns:
                yield from self._known(waiting.pop(), motion)
        while waiting:
            yield from self._known(waiting.pop(), motion)

    def _known(self, found: _Found, motion: MotionHistory) -> Iterator[CrossingWithSlip]:
        passage = found.passage
        told = motion.mean(found.wheel, passage.begin_ns, passage.end_ns)
        if passage.samples is None or not math.isfinite(told.slip[0]):
            return
        patch = self.robot.tire.contact_length
        turned = max(passage.speed_change - SPEED_NOISE, 0.0)
        change = told.slip_rate * patch / passage.speed
        sigma = math.hypot(CHANGE_NOISE, CHANGE_ERROR * change,
                           UNSEEN * turned * patch / passage.way)
        yield CrossingWithSlip(
            found.wheel, passage.stamp_ns, passage.direction, passage.speed, passage.samples,
            told.slip, math.hypot(told.slip_bend, TRANSIENT * turned), (change, sigma),
            found.origin)
