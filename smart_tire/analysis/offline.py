"""One bag through the estimators: estimates to a bag, what they tell to a summary."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
import json
from pathlib import Path

import numpy as np

from smart_tire.analysis.inputs import StampLog
from smart_tire.analysis.pipeline import ESTIMATES, EstimatorParams, INPUTS, Pipeline, TRUTHS
from smart_tire.analysis.series import Series
from smart_tire.analysis.summary import estimates_tree, plain, Tree, truth_tree
from smart_tire.bags import Bag, BagWriter
from smart_tire.errors import BagError
from smart_tire.messages import find_topic, topic_of
from smart_tire.samples import NS_PER_S, Sample, WheelSample

REPORT_EVERY = 500  # messages between two reports of progress
NEEDED_FOR = {'imu/data': 'no odom, wheel_slip and icr', 'tire_samples': 'no tire_friction',
              'wheel_states': 'no odom, wheel_slip, icr and tire_friction'}
COMPARED = dict(zip(TRUTHS, ('poses', 'slips', 'friction values')))

Progress = Callable[[float], None]  # takes the share that is done, 0 to 1


@dataclass
class Run:
    """What went into the estimators and what came out."""

    inputs: Series = field(default_factory=Series)
    estimates: Series = field(default_factory=Series)
    truth: Series = field(default_factory=Series)
    stamps: StampLog = field(default_factory=StampLog)
    without_positions: int = 0  # wheel samples
    left_out: list[str] = field(default_factory=list)
    summary: Tree | None = None  # None where nothing could be estimated

    def take(self, topic: str, sample: Sample) -> None:
        """Note an input."""
        self.stamps.add(topic, sample)
        self.inputs.add(sample)
        if isinstance(sample, WheelSample) and sample.position is None:
            self.without_positions += 1


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
    run, pipeline = Run(), Pipeline(params)
    with Bag(path) as bag, ExitStack() as stack:
        writer: BagWriter | None = None
        for receive_ns, topic, sample in _reporting(bag, progress):
            if topic in TRUTHS:
                run.truth.add(sample)
                continue
            run.take(topic, sample)
            for estimate in pipeline.update(sample):
                if writer is None:
                    writer = stack.enter_context(BagWriter(_cleared(folder)))
                writer.write_sample(topic_of(estimate), receive_ns, estimate)
                run.estimates.add(estimate)
        run.left_out = _left_out(bag, run, params.friction.robot.film.wheels)
        if writer is not None:
            run.summary = _summary(bag, run, pipeline)
            _write(out / 'summary.json', run.summary)
    return run


def _reporting(bag: Bag, progress: Progress) -> Iterator[tuple[int, str, Sample]]:
    start, end = bag.span_ns
    for count, message in enumerate(bag.samples((*INPUTS, *TRUTHS))):
        if count % REPORT_EVERY == 0:
            progress((message[0] - start) / max(1, end - start))
        yield message
    progress(1.0)


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


def _summary(bag: Bag, run: Run, pipeline: Pipeline) -> Tree:
    start, end = bag.span_ns
    inputs = {topic: {**asdict(stats), 'late': pipeline.late[topic],
                      'rejected': bag.rejected[topic]}
              for topic, stats in run.stamps.stats().items()}
    return {'bag': str(bag.path), 'duration_s': plain((end - start) / NS_PER_S),
            'inputs': plain(inputs), 'left_out': run.left_out,
            'estimates': estimates_tree(run.estimates),
            'against_truth': truth_tree(run.estimates, run.truth)}


def _left_out(bag: Bag, run: Run, film_wheels: Sequence[str]) -> list[str]:
    """Return what was not read, not used or not estimated, each with the reason."""
    there = bag.match((*INPUTS, *TRUTHS))
    lines = [f'{name} is not in the bag: {lost}' for name, lost in NEEDED_FOR.items()
             if name not in there]
    if run.without_positions:
        lines.append(f'positions of wheel_states: {run.without_positions} messages have none, '
                     'their velocities are used')
    lines += [f'tire_samples of {wheel}: it is not among film.wheels'
              for wheel in run.inputs.film_wheels() if wheel not in film_wheels]
    if not there.keys() & set(TRUTHS):
        lines.append('ground truth is not in the bag: nothing is compared')
    else:
        lines += [f'{name} is not in the bag: {what} are not compared'
                  for name, what in COMPARED.items() if name not in there]
    if np.isnan(run.truth.poses().twist).any():
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
