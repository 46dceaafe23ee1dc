"""
Patch crossings of all instrumented wheels of a recording, with the slip in each.

Crossings are detected first. The slips come afterwards, from a slip estimator smoothed over the
whole recording, without films.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
import math

from smart_tire.estimation.contact.records import CrossingSamples, PatchCrossing
from smart_tire.estimation.contact.tracker import ContactTracker
from smart_tire.estimation.friction.estimator import BLOCK_NS, TOPICS
from smart_tire.estimation.friction.motion_history import MotionHistory
from smart_tire.estimation.friction.slip_variation import estimated_variation
from smart_tire.estimation.plausibility import is_possible
from smart_tire.estimation.reorder_buffer import ReorderBuffer
from smart_tire.parameters import RobotParams
from smart_tire.samples import NS_PER_S, TireSample, WHEELS, WheelSample, WheelSlip
from smart_tire.uncertain import Uncertain

SLIP_MARGIN_NS = 500_000_000  # of slips after a crossing that are used for mean and slope


@dataclass(frozen=True, slots=True)
class CrossingWithSlip:
    """A patch crossing with waveforms of the films, and the slip in it."""

    wheel: str
    stamp_ns: int
    direction: int  # +1 forward, -1 backward
    speed: float    # m/s, r |omega|
    films: CrossingSamples
    slip: Uncertain    # -, B(3)'s lambda at the reference
    deviation: float   # -, standard deviation of slip from a straight line in this crossing
    change: Uncertain  # -, of the slip over a contact length
    origin: float      # rad, ``wheel_states.position`` at distance 0; NaN without positions


@dataclass(frozen=True, slots=True)
class _FoundCrossing:
    wheel: str
    crossing: PatchCrossing
    origin: float


@dataclass
class _Wheel:
    """Trackers of one wheel, one per film group."""

    trackers: list[ContactTracker]
    origin: float = math.nan
    started: bool = False
    newest_ns: int = 0


@dataclass
class CrossingCollector:
    """Collects the crossings of ``robot`` from samples in the order of reception."""

    robot: RobotParams
    reorder_window: float  # s
    tire_samples: int = 0  # of instrumented wheels
    crossings: int = 0     # detected or predicted
    _found: list[_FoundCrossing] = field(default_factory=list)

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
        """Process one sample."""
        closed = self._gate.push(TOPICS[type(sample)], sample.stamp_ns, sample)
        if self._gate.resets != self._resets:
            self._resets = self._gate.resets
            self._start()
        for instant, samples in closed:
            for item in samples:
                self._add(item)
            if instant % BLOCK_NS == 0:
                self._advance(instant)

    def _add(self, sample: TireSample | WheelSample) -> None:
        if isinstance(sample, WheelSample):
            if sample.stamp_ns > self._wheels_ns and is_possible(sample):
                self._wheels_ns = sample.stamp_ns
                self._add_wheels(sample)
            return
        wheel = self._wheels.get(sample.wheel)
        if wheel is not None and sample.stamp_ns > wheel.newest_ns and is_possible(sample):
            wheel.newest_ns = sample.stamp_ns
            self.tire_samples += 1
            for tracker in wheel.trackers:
                tracker.add_films(sample)

    def _add_wheels(self, sample: WheelSample) -> None:
        for name, wheel in self._wheels.items():
            if sample.position is None:  # distances are integrated without positions
                wheel.origin = math.nan
            elif not wheel.started:
                wheel.origin = sample.position[WHEELS.index(name)]
            wheel.started = True
            for tracker in wheel.trackers:
                tracker.add_wheels(sample)

    def _advance(self, instant: int) -> None:
        for name, wheel in self._wheels.items():
            for tracker in wheel.trackers:
                for crossing in tracker.advance(instant):
                    self.crossings += 1
                    if crossing.samples is not None:
                        self._found.append(_FoundCrossing(name, crossing, wheel.origin))

    def with_slip(self, slips: Iterable[WheelSlip]) -> Iterator[CrossingWithSlip]:
        """Yield the crossings covered by ``slips``, which must be in the order of time."""
        pending = sorted(self._found, key=lambda found: found.crossing.end_ns, reverse=True)
        motion = MotionHistory(self.robot, 0.0)
        for slip in slips:
            motion.add_slip(slip)
            while pending and pending[-1].crossing.end_ns + SLIP_MARGIN_NS < slip.stamp_ns:
                yield from self._with_slip(pending.pop(), motion)
        while pending:
            yield from self._with_slip(pending.pop(), motion)

    def _with_slip(self, found: _FoundCrossing,
                   motion: MotionHistory) -> Iterator[CrossingWithSlip]:
        crossing = found.crossing
        mean = motion.mean(found.wheel, crossing.begin_ns, crossing.end_ns)
        if crossing.samples is None or not math.isfinite(mean.slip.value):
            return
        variation = estimated_variation(crossing, mean, self.robot.tire.contact_length)
        yield CrossingWithSlip(
            found.wheel, crossing.stamp_ns, crossing.direction, crossing.speed, crossing.samples,
            mean.slip, variation.residual, variation.change, found.origin)
