"""One bag through the estimators: estimates to a bag, what they tell to a summary."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, ExitStack
from dataclasses import asdict, dataclass, field
from functools import partial
import json
from pathlib import Path

import numpy as np

from smart_tire.analysis.ahead import ahead
from smart_tire.analysis.inputs import StampLog
from smart_tire.analysis.pipeline import (
    ESTIMATES, EstimatorParams, FrictionStage, INPUTS, SlipStage, TRUTHS)
from smart_tire.analysis.series import Series
from smart_tire.analysis.summary import estimates_tree, plain, Tree, truth_tree
from smart_tire.bags import Bag, BagWriter
from smart_tire.errors import BagError
from smart_tire.messages import find_topic, topic_of
from smart_tire.samples import NS_PER_S, Sample, WheelSample

BATCH = 500  # messages that go from one stage to the next together
NEEDED_FOR = {'imu/data': 'no odom, wheel_slip and icr', 'tire_samples': 'no tire_friction',
              'wheel_states': 'no odom, wheel_slip, icr and tire_friction'}
COMPARED = dict(zip(TRUTHS, ('poses', 'slips', 'friction values')))

Progress = Callable[[float], None]  # takes the share that is done, 0 to 1


@dataclass
class Intake:
    """What the bag held."""

    inputs: Series = field(default_factory=Series)
    truth: Series = field(default_factory=Series)
    stamps: StampLog = field(default_factory=StampLog)
    without_positions: int = 0  # wheel samples
    late: Counter[str] = field(default_factory=Counter)
    rejected: Counter[str] = field(default_factory=Counter)
    left_out: list[str] = field(default_factory=list)
    duration_s: float = 0.0

    def take(self, topic: str, sample: Sample) -> None:
        """Note an input."""
        self.stamps.add(topic, sample)
        self.inputs.add(sample)
        if isinstance(sample, WheelSample) and sample.position is None:
            self.without_positions += 1


@dataclass
class Batch:
    """What the slip stage made of some messages."""

    share: float                      # of the bag that is done
    passed: list[tuple[int, Sample]]  # received at [ns], for the friction stage


@dataclass
class Run:
    """What went into the estimators and what came out."""

    intake: Intake = field(default_factory=Intake)
    estimates: Series = field(default_factory=Series)
    summary: Tree | None = None  # None where nothing could be estimated


def analyze(path: Path, out: Path, params: EstimatorParams,
            progress: Progress = lambda share: None) -> Run:
    """
    Write what the bag at ``path`` tells: a bag ``out``/estimates and ``out``/summary.json.

    Nothing is written where nothing can be estimated; estimates of a former run are replaced.
    Raises BagError if the bag can not be read or ``out`` not be written.
    """
    folder = out / 'estimates'
    if folder.resolve() in (path.resolve(), path.resolve().parent):
        raise BagError(f'{folder}: is the bag that is read; choose another --out')
    run, stage = Run(), FrictionStage(params)
    writer: BagWriter | None = None
    with ExitStack() as stack:
        for item in stack.enter_context(closing(ahead(partial(_read, path, params)))):
            if isinstance(item, Intake):
                run.intake = item
                continue
            progress(item.share)
            for receive_ns, sample in item.passed:
                for estimate in stage.update(sample):
                    if writer is None:
                        writer = stack.enter_context(BagWriter(_cleared(folder)))
                    writer.write_sample(topic_of(estimate), receive_ns, estimate)
                    run.estimates.add(estimate)
    if writer is not None:
        run.summary = _summary(path, run, stage)
        _write(out / 'summary.json', run.summary)
    return run


def _read(path: Path, params: EstimatorParams) -> Iterator[Batch | Intake]:
    """Yield the bag's messages, through the slip stage, and at last what the bag held."""
    intake, stage = Intake(), SlipStage(params)
    with Bag(path) as bag:
        start, end = bag.span_ns
        passed: list[tuple[int, Sample]] = []
        for count, (receive_ns, topic, sample) in enumerate(bag.samples((*INPUTS, *TRUTHS))):
            if topic in TRUTHS:
                intake.truth.add(sample)
            else:
                intake.take(topic, sample)
                passed += [(receive_ns, item) for item in stage.update(sample)]
            if count % BATCH == 0:
                yield Batch((receive_ns - start) / max(1, end - start), passed)
                passed = []
        yield Batch(1.0, passed)
        intake.late, intake.rejected = stage.late, bag.rejected
        intake.duration_s = (end - start) / NS_PER_S
        intake.left_out = _left_out(bag, intake, params.friction.robot.film.wheels)
    yield intake


def _cleared(folder: Path) -> Path:
    """Return ``folder`` without the bag of a former run; what else is in it stays."""
    former = [*folder.glob(f'{folder.name}_*.mcap'), *folder.glob('metadata.yaml')]
    try:
        for file in former:
            file.unlink()
        if former and not any(folder.iterdir()):
            folder.rmdir()
    except OSError as error:
        raise BagError(f'{folder}: cannot be replaced ({error.strerror})') from error
    return folder


def _summary(path: Path, run: Run, stage: FrictionStage) -> Tree:
    intake = run.intake
    late = intake.late | stage.late  # the greater one where both stages take a topic
    inputs = {topic: {**asdict(stats), 'late': late[topic], 'rejected': intake.rejected[topic]}
              for topic, stats in intake.stamps.stats().items()}
    return {'bag': str(path), 'duration_s': plain(intake.duration_s),
            'inputs': plain(inputs), 'left_out': intake.left_out,
            'estimates': estimates_tree(run.estimates),
            'against_truth': truth_tree(run.estimates, intake.truth)}


def _left_out(bag: Bag, intake: Intake, film_wheels: Sequence[str]) -> list[str]:
    """Return what was not read, not used or not estimated, each with the reason."""
    there = bag.match((*INPUTS, *TRUTHS))
    lines = [f'{name} is not in the bag: {lost}' for name, lost in NEEDED_FOR.items()
             if name not in there]
    if intake.without_positions:
        lines.append(f'positions of wheel_states: {intake.without_positions} messages have none, '
                     'their velocities are used')
    lines += [f'tire_samples of {wheel}: it is not among film.wheels'
              for wheel in intake.inputs.film_wheels() if wheel not in film_wheels]
    if not there.keys() & set(TRUTHS):
        lines.append('ground truth is not in the bag: nothing is compared')
    else:
        lines += [f'{name} is not in the bag: {what} are not compared'
                  for name, what in COMPARED.items() if name not in there]
    if np.isnan(intake.truth.poses().twist).any():
        lines.append('twist of ground_truth/odom is not given: speeds are not compared')
    return lines + _unread(bag, there)


def _unread(bag: Bag, there: dict[str, str]) -> list[str]:
    """Return what of the bag was passed over though its name is known, or was refused."""
    lines = [f'{misfit}: is not read' for misfit in bag.misfits()]
    for name in bag.topics:
        topic = find_topic(name)
        if topic is not None and topic.name in ESTIMATES:
            lines.append(f'{name}: a former estimate, is not read')
        elif topic is not None and there.get(topic.name, name) != name:
            lines.append(f'{name}: is not read beside {there[topic.name]}')
    lines += [f'{count} messages of {topic}: refused, the first because {bag.reasons[topic]}'
              for topic, count in bag.rejected.items()]
    return lines + bag.losses


def _write(path: Path, summary: Tree) -> None:
    try:
        path.write_text(json.dumps(summary, indent=2, allow_nan=False) + '\n', encoding='utf-8')
    except OSError as error:
        raise BagError(f'{path}: cannot be written ({error.strerror})') from error
