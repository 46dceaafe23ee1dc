# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A recording in the viewer: what the bag contains, or estimates that are computed from it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
import heapq
import json
from operator import itemgetter
from pathlib import Path

from smart_tire.analysis.pipeline import ESTIMATES, EstimatorParams, INPUTS, Pipeline
from smart_tire.bags import Bag, STANDARD_NAMES, TopicNames
from smart_tire.errors import BagError
from smart_tire.messages import NodeStatus, topic_of
from smart_tire.samples import Friction, Sample
from smart_tire.view.scene import Scene

FLUSH_SAMPLES = 20_000  # between two transmissions to the viewer
ANALYZED = 'estimates', 'smoothed'  # folders that "smart_tire analyze" writes
REQUIRED = 'odom', 'wheel_slip'  # without these a bag has no estimates to show

Progress = Callable[[float], None]  # is called with the completed share, 0 to 1


@dataclass(frozen=True)
class Recording:
    """Files of a recording: its bag, and a bag with estimates."""

    bag: Path
    estimates: Path | None = None


def find_recording(path: Path) -> Recording:
    """
    Return the recording at ``path``: a bag, or the estimates of an analysis with the input bag.

    The estimates of an analysis without its input bag are shown on their own.
    """
    if path.name not in ANALYZED:
        return Recording(path)
    source = _analyzed_bag(path.parent / 'summary.json')
    return Recording(path) if source is None else Recording(source, path)


def _analyzed_bag(summary: Path) -> Path | None:
    """Return the bag that ``summary`` names, None if it is missing."""
    try:
        bag = Path(json.loads(summary.read_text(encoding='utf-8'))['bag'])
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BagError(f'{summary}: not the summary of an analysis ({error})') from error
    return bag if bag.exists() else None


def show(recording: Recording, scene: Scene, params: EstimatorParams, *, estimate: bool,
         describe: Callable[[str], None], progress: Progress = lambda share: None,
         names: TopicNames = STANDARD_NAMES) -> None:
    """
    Show a recording; with ``estimate`` or without recorded estimates, run the estimators on it.

    ``describe`` is called with one line that says which estimates are shown. ``names`` are the
    topics with other names in the bag. Raises BagError.
    """
    with ExitStack() as stack:
        bag = stack.enter_context(Bag(recording.bag, names, params.robot.joints))
        for stamp_ns, status in bag.statuses():
            scene.add_status(stamp_ns, status)
        if estimate or (recording.estimates is None and not set(REQUIRED) <= bag.match(
                REQUIRED).keys()):
            describe(f'{recording.bag}: estimates computed now with these parameters'
                     + ('' if estimate else ' (the bag has none)'))
            samples = _estimated(bag, scene, params)
        elif recording.estimates is not None:
            describe(f'{recording.bag}: estimates of {recording.estimates}')
            other = stack.enter_context(Bag(recording.estimates))
            samples = heapq.merge(bag.samples(_without_estimates(scene)),
                                  other.samples(ESTIMATES), key=itemgetter(0))
        else:
            describe(f'{recording.bag}: recorded estimates')
            samples = bag.samples(scene.topics)
        _feed(samples, scene, bag.span_ns, progress)


def _feed(samples: Iterator[tuple[int, str, Sample]], scene: Scene, span_ns: tuple[int, int],
          progress: Progress) -> None:
    start, end = span_ns
    for count, (receive_ns, topic, sample) in enumerate(samples):
        scene.add_sample(topic, sample)
        if count % FLUSH_SAMPLES == 0:
            scene.flush()
            progress(min((receive_ns - start) / max(1, end - start), 1.0))
    scene.finish()
    progress(1.0)


def _estimated(bag: Bag, scene: Scene,
               params: EstimatorParams) -> Iterator[tuple[int, str, Sample]]:
    """Yield the samples of ``bag`` other than estimates, and estimates computed from them."""
    pipeline, receive_ns = Pipeline(params), 0
    for receive_ns, topic, sample in bag.samples(_without_estimates(scene)):
        yield receive_ns, topic, sample
        if topic in INPUTS:
            for found in pipeline.update(sample):
                yield receive_ns, topic_of(found), found
                if isinstance(found, Friction):
                    scene.add_status(found.stamp_ns, NodeStatus(
                        'friction_estimator', 0, 'computed now', pipeline.status))
    for found in pipeline.finish():
        yield receive_ns, topic_of(found), found


def _without_estimates(scene: Scene) -> list[str]:
    return [topic for topic in scene.topics if topic not in ESTIMATES]
