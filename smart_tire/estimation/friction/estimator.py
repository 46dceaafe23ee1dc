"""
Friction estimator: one record for each passage of a wheel's films through the contact patch.

All inputs pass one gate, so live, replayed and recorded data give the same numbers.
"""

from __future__ import annotations

from collections import Counter
from itertools import chain
from math import inf, isfinite

from smart_tire.errors import EstimatorError
from smart_tire.estimation.contact.tracker import ContactTracker
from smart_tire.estimation.friction.motion_history import MotionHistory
from smart_tire.estimation.friction.output import OutputBuilder
from smart_tire.estimation.reorder_buffer import ReorderBuffer
from smart_tire.parameters import FrictionEstimatorParams
from smart_tire.samples import (
    Friction, MAX_WHEEL_SPEED, NS_PER_S, Odometry, Sample, TireSample, WheelSample, WheelSlip)

BLOCK_NS = 48_000_000  # of message time, six grid steps, in which samples are worked off together
TOPICS: dict[type, str] = {TireSample: 'tire_samples', WheelSample: 'wheel_states',
                           Odometry: 'odom', WheelSlip: 'wheel_slip'}
WIDEST_SLIP_SIGMA = 1e3  # of a ratio within +-1; a finite one beyond is an accident
Input = TireSample | WheelSample | Odometry | WheelSlip


class FrictionEstimator:
    """
    Friction from the films of all instrumented wheels.

    Needs tire and wheel samples; without odometry or slip the passages are still found, and told
    is what the films tell alone.
    """

    def __init__(self, params: FrictionEstimatorParams) -> None:
        self._params = params
        self._gate = ReorderBuffer(round(params.reorder_window * NS_PER_S),
                          awaited=(TOPICS[Odometry], TOPICS[WheelSlip]))
        self._resets = 0
        self.passages = 0
        self.passages_lost = 0     # passages without any film
        self.foreign_samples = 0   # of wheels that are not instrumented
        self.dropped: Counter[str] = Counter()  # topic -> duplicates and impossible samples
        self._start()

    def _start(self) -> None:
        robot = self._params.robot
        self._newest: dict[tuple[type, str], int] = {}  # stream, of films by wheel -> stamp
        self._motion = MotionHistory(robot, self._params.load_sigma)
        self._films = {wheel: [ContactTracker(wheel, robot, films) for films in robot.film_groups]
                       for wheel in robot.film.wheels}
        self._reporters = {wheel: OutputBuilder(wheel, self._params)
                           for wheel in robot.film.wheels}

    @property
    def late(self) -> Counter[str]:
        """Samples per topic that came after their grid instant had closed."""
        return self._gate.late

    def reset(self) -> None:
        """Forget all samples, all that was learned and the time; keep the counters."""
        self._gate.reset()
        self._start()

    def update(self, sample: Sample) -> list[Friction]:
        """Take in a sample of one of the four inputs; return the passages that it completes."""
        topic = TOPICS.get(type(sample))
        if topic is None:
            raise EstimatorError(f'friction estimator was fed a {type(sample).__name__}, expected '
                                 + ', '.join(kind.__name__ for kind in TOPICS))
        closed = self._gate.push(topic, sample.stamp_ns, sample)
        if self._gate.resets != self._resets:
            self._resets = self._gate.resets
            self._start()
        found: list[Friction] = []
        for instant, samples in closed:
            for item in samples:
                self._take(item)
            if instant % BLOCK_NS == 0:  # a fixed phase, whenever the first sample came
                found += self._advance(instant)
        return found

    def _take(self, sample: Input) -> None:
        if isinstance(sample, TireSample):
            groups = self._films.get(sample.wheel)
            if groups is None:
                self.foreign_samples += 1
            elif self._is_new(sample.wheel, sample):
                for films in groups:
                    films.add_films(sample)
        elif self._is_new('', sample):
            self._add(sample)

    def _is_new(self, wheel: str, sample: Input) -> bool:
        """Return whether ``sample`` can be, and is younger than its stream; count it if not."""
        kind, stamp_ns = type(sample), sample.stamp_ns
        if _is_possible(sample) and stamp_ns > self._newest.get((kind, wheel), -inf):
            self._newest[kind, wheel] = stamp_ns
            return True
        self.dropped[TOPICS[kind]] += 1
        return False

    def _add(self, sample: Input) -> None:
        if isinstance(sample, WheelSample):
            for films in chain(*self._films.values()):
                films.add_wheels(sample)
        elif isinstance(sample, Odometry):
            self._motion.add_odometry(sample)
        elif isinstance(sample, WheelSlip):
            self._motion.add_slip(sample)

    def _advance(self, instant: int) -> list[Friction]:
        found = []
        for wheel, groups in self._films.items():
            passages = [passage for films in groups for passage in films.advance(instant)]
            for passage in sorted(passages, key=lambda passage: passage.stamp_ns):
                motion = self._motion.mean(wheel, passage.begin_ns, passage.end_ns)
                found.append(self._reporters[wheel].report(passage, motion))
                self.passages += 1
                self.passages_lost += passage.samples is None
        return found

    def status(self) -> dict[str, str | int | float]:
        """Return what diagnostics should show."""
        shown: dict[str, str | int | float] = {
            'passages': self.passages, 'passages_lost': self.passages_lost,
            'foreign_samples': self.foreign_samples, 'clock_resets': self._gate.resets,
            **{f'dropped.{topic}': count for topic, count in self.dropped.items()}}
        for wheel, groups in self._films.items():
            mu, sigma = self._reporters[wheel].fusion.estimate()
            shown[f'{wheel}_friction'] = f'{mu:.3f} +- {sigma:.3f}' if mu == mu else 'unknown'
            shown[f'{wheel}_contacts_unmeasured'] = sum(films.unmeasured for films in groups)
            shown[f'{wheel}_ground_changes'] = self._reporters[wheel].fusion.changes
        return shown


def _is_possible(sample: Input) -> bool:
    """Return whether a robot and its sensors can have given ``sample``."""
    if isinstance(sample, TireSample):
        return all(map(isfinite, sample.volts))
    if isinstance(sample, WheelSample):
        return all(abs(speed) <= MAX_WHEEL_SPEED for speed in sample.velocity)
    if isinstance(sample, Odometry):
        return all(map(isfinite, sample.linear)) and all(map(isfinite, sample.angular))
    return not any(abs(ratio) > 1.0 for ratio in sample.ratio) and all(
        0.0 <= sigma <= WIDEST_SLIP_SIGMA or sigma == inf for sigma in sample.sigma)
