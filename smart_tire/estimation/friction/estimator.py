"""
Friction estimator: one record for each patch crossing of an instrumented wheel.

All inputs pass one reorder buffer, so live, replayed and recorded data give identical results.
"""

from __future__ import annotations

from collections import Counter
from itertools import chain
from math import inf

from smart_tire.errors import EstimatorError
from smart_tire.estimation.contact.tracker import ContactTracker
from smart_tire.estimation.friction.motion_history import MotionHistory
from smart_tire.estimation.friction.output import OutputBuilder
from smart_tire.estimation.plausibility import is_possible
from smart_tire.estimation.reorder_buffer import ReorderBuffer
from smart_tire.parameters import FrictionEstimatorParams
from smart_tire.samples import (
    Friction, NS_PER_S, Odometry, Sample, TireSample, WheelSample, WheelSlip)

BLOCK_NS = 48_000_000  # of message time, six grid steps, in which samples are processed together
TOPICS: dict[type, str] = {TireSample: 'tire_samples', WheelSample: 'wheel_states',
                           Odometry: 'odom', WheelSlip: 'wheel_slip'}
Input = TireSample | WheelSample | Odometry | WheelSlip


class FrictionEstimator:
    """
    Friction from the films of all instrumented wheels.

    Requires tire and wheel samples. Without odometry or slip, crossings are still found, with the
    quantities that the films determine alone.
    """

    def __init__(self, params: FrictionEstimatorParams) -> None:
        self._params = params
        self._buffer = ReorderBuffer(round(params.reorder_window * NS_PER_S),
                                     awaited=(TOPICS[Odometry], TOPICS[WheelSlip]))
        self._resets = 0
        self.crossings = 0
        self.crossings_lost = 0    # without samples of any film
        self.foreign_samples = 0   # of wheels that are not instrumented
        self.dropped: Counter[str] = Counter()  # topic -> duplicates and impossible samples
        self._start()

    def _start(self) -> None:
        robot = self._params.robot
        self._newest: dict[tuple[type, str], int] = {}  # stream, of films by wheel -> timestamp
        self._motion = MotionHistory(robot, self._params.load_sigma)
        self._trackers = {wheel: [ContactTracker(wheel, robot, films)
                                  for films in robot.film_groups]
                          for wheel in robot.film.wheels}
        self._outputs = {wheel: OutputBuilder(wheel, self._params) for wheel in robot.film.wheels}

    @property
    def late(self) -> Counter[str]:
        """Samples per topic that arrived after their grid instant had closed."""
        return self._buffer.late

    def reset(self) -> None:
        """Drop all samples and everything learned; keep the counters."""
        self._buffer.reset()
        self._start()

    def update(self, sample: Sample) -> list[Friction]:
        """Add a sample of one of the four inputs; return the records that it completes."""
        topic = TOPICS.get(type(sample))
        if topic is None:
            raise EstimatorError(f'friction estimator received {type(sample).__name__}, expected '
                                 + ', '.join(kind.__name__ for kind in TOPICS))
        closed = self._buffer.push(topic, sample.stamp_ns, sample)
        if self._buffer.resets != self._resets:
            self._resets = self._buffer.resets
            self._start()
        found: list[Friction] = []
        for instant, samples in closed:
            for item in samples:
                self._take(item)
            if instant % BLOCK_NS == 0:  # a fixed phase, independent of the first sample
                found += self._advance(instant)
        return found

    def _take(self, sample: Input) -> None:
        if isinstance(sample, TireSample):
            trackers = self._trackers.get(sample.wheel)
            if trackers is None:
                self.foreign_samples += 1
            elif self._is_new(sample.wheel, sample):
                for tracker in trackers:
                    tracker.add_films(sample)
        elif self._is_new('', sample):
            self._add(sample)

    def _is_new(self, wheel: str, sample: Input) -> bool:
        """Return whether ``sample`` is possible and newer than its stream; count it if not."""
        kind, stamp_ns = type(sample), sample.stamp_ns
        if is_possible(sample) and stamp_ns > self._newest.get((kind, wheel), -inf):
            self._newest[kind, wheel] = stamp_ns
            return True
        self.dropped[TOPICS[kind]] += 1
        return False

    def _add(self, sample: Input) -> None:
        if isinstance(sample, WheelSample):
            for tracker in chain(*self._trackers.values()):
                tracker.add_wheels(sample)
        elif isinstance(sample, Odometry):
            self._motion.add_odometry(sample)
        elif isinstance(sample, WheelSlip):
            self._motion.add_slip(sample)

    def _advance(self, instant: int) -> list[Friction]:
        found = []
        for wheel, trackers in self._trackers.items():
            crossings = [crossing for tracker in trackers for crossing in tracker.advance(instant)]
            for crossing in sorted(crossings, key=lambda crossing: crossing.stamp_ns):
                motion = self._motion.mean(wheel, crossing.begin_ns, crossing.end_ns)
                found.append(self._outputs[wheel].build(crossing, motion))
                self.crossings += 1
                self.crossings_lost += crossing.samples is None
        return found

    def status(self) -> dict[str, str | int | float]:
        """Return the values for diagnostics."""
        shown: dict[str, str | int | float] = {
            'crossings': self.crossings, 'crossings_lost': self.crossings_lost,
            'foreign_samples': self.foreign_samples, 'clock_resets': self._buffer.resets,
            **{f'dropped.{topic}': count for topic, count in self.dropped.items()}}
        for wheel, trackers in self._trackers.items():
            mu, sigma = self._outputs[wheel].filter.estimate()
            shown[f'{wheel}_friction'] = f'{mu:.3f} +- {sigma:.3f}' if mu == mu else 'unknown'
            shown[f'{wheel}_segments_undetected'] = sum(
                tracker.undetected for tracker in trackers)
            shown[f'{wheel}_surface_changes'] = self._outputs[wheel].filter.changes
        return shown
