# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire record``: record topics into a bag."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from datetime import datetime, timedelta
from pathlib import Path
import shutil
import time

from rich.filesize import decimal

from smart_tire.cli._bags import print_counts
from smart_tire.cli._outputs import refuse_existing_bag, remove_bag
from smart_tire.cli._progress import ProgressLine, Rate
from smart_tire.errors import ParameterError

MIN_SIZE, MIN_DURATION = 1.0, 1.0  # MB, s of a file: a bag of thousands of files opens slowly


class RecordStatus:
    """Progress of a recording into ``directory`` as text."""

    def __init__(self, directory: Path, clock: Callable[[], float] = time.monotonic) -> None:
        self._directory, self._clock = directory, clock  # s
        self._start = clock()
        self._rate = Rate()

    def text(self, counts: Mapping[str, int], lost: int) -> str:
        """Return elapsed time, messages, rate, size, free disk space and lost messages."""
        now, messages = self._clock(), sum(counts.values())
        rate = self._rate.since(messages, now)
        size = sum(file.stat().st_size for file in self._directory.iterdir())
        parts = [str(timedelta(seconds=int(now - self._start))),
                 f'{messages} messages on {len(counts)} topic' + 's' * (len(counts) != 1),
                 '' if rate is None else f'{rate:.0f}/s', decimal(size),
                 f'{decimal(shutil.disk_usage(self._directory).free)} free',
                 f'{lost} lost' if lost else '']
        return '  '.join(part for part in parts if part)


def run(args: argparse.Namespace) -> int:
    """
    Record until interrupted; print the message count of each topic.

    Lost messages are reported, but do not change the exit status. Raises ParameterError for files
    below ``MIN_SIZE`` or ``MIN_DURATION``.
    """
    for name, value, least in (('size', args.max_size, MIN_SIZE),
                               ('duration', args.max_duration, MIN_DURATION)):
        if value < least:
            raise ParameterError(f'--max-{name} is {value:g}, expected at least {least:g}')
    directory = args.out or Path(f'rosbag2_{datetime.now():%Y_%m_%d-%H_%M_%S}')
    refuse_existing_bag(directory, force=args.force)
    parameters = None
    if args.params:  # the import would delay the start of the recording
        from smart_tire.analysis.pipeline import EstimatorParams
        parameters = EstimatorParams.load(args.params).by_node()
    from smart_tire.nodes.recorder import record
    remove_bag(directory)
    with ProgressLine(timer=False) as progress:
        status = RecordStatus(directory)
        recording = record(directory, args.topics, parameters,
                           lambda counts, lost: progress.show(status.text(counts, lost)),
                           max_size=args.max_size * 1e6, max_duration=args.max_duration)
    print(f'{directory}:')
    print_counts(recording.counts)
    for loss in recording.losses:
        print(loss)
    return recording.status
