# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Checks of rates, gaps and timestamps.

The delay of a message is its receive time minus its timestamp. Its smallest values vary little, so
their change over the recording shows clocks that drift against each other.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from smart_tire.analysis.checks.recording import CheckedRecording
from smart_tire.arrays import Array
from smart_tire.findings import counted, Finding, Level
from smart_tire.messages import TOPICS
from smart_tire.numerics.robust import MAD_TO_SIGMA
from smart_tire.recording import Stream
from smart_tire.samples import NS_PER_S

INPUTS = ('imu/data', 'wheel_states', 'tire_samples')
MIN_RATE = {'imu/data': 20.0, 'wheel_states': 4.0}  # Hz; docs/topics.md
MIN_MESSAGES = 10
RATE_TOLERANCE = 0.2         # relative, from the nominal rate; beyond, it is worth a line
FILM_RATE_TOLERANCE = 0.02   # relative, from film.sample_rate
MAX_GAP = {'imu/data': 0.1, 'wheel_states': 0.5}  # s; longer ones are bridged by prediction
MIN_GAP_PERIODS = 3.5        # median periods
BATCH_GAP_PERIODS = 1.5      # median periods between film samples: a radio batch is missing
MAX_LOST_SHARE = 0.05        # of the film samples: one crossing in twenty is incomplete
MAX_JITTER = 0.3             # standard deviation of the period over the period
MAX_DELAY = 0.5              # s, from timestamp to reception
MAX_LEAD = 0.05              # s, of a timestamp before reception: clocks differ
MAX_CLOCK_DIFFERENCE = 0.5   # s, between the median delays of two inputs
MAX_DRIFT = 200e-6           # s/s; crystals differ by up to 100e-6
MIN_DRIFT_CHANGE = 0.010     # s, over the recording
MIN_DRIFT_TIME = 20.0        # s
DRIFT_BLOCKS = 20            # whose smallest delays give the drift
SIGMAS = 3.0                 # standard errors
MAX_HELD_SHARE = 0.05        # of samples equal to the previous one: more is not chance


def check_rates(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield rates below what the estimators need, and rates that differ from the nominal one."""
    for stream in _regular(recording):
        rate, nominal = 1.0 / stream.period, TOPICS[stream.topic].rate
        if stream.topic == 'tire_samples':
            nominal = recording.robot.film.sample_rate
            if abs(rate / nominal - 1.0) > FILM_RATE_TOLERANCE:
                yield Finding(Level.WARNING, stream.name, f'{rate:.4g} Hz',
                              f'film.sample_rate {nominal:g} Hz', 'correct film.sample_rate')
                continue
        elif rate < 0.9 * MIN_RATE[stream.topic]:
            yield Finding(Level.WARNING, stream.name, f'{rate:.3g} Hz',
                          f'at least {MIN_RATE[stream.topic]:g} Hz', 'raise the rate of its '
                          'driver')
            continue
        differs = abs(rate / nominal - 1.0) > RATE_TOLERANCE
        yield Finding(Level.INFO if differs else Level.OK, stream.name,
                      f'{rate:.4g} Hz, {len(stream.stamp_ns)} messages',
                      f'{nominal:g} Hz' if differs else '')


def check_gaps(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield gaps between timestamps; in film samples these are lost radio batches."""
    for stream in _regular(recording):
        steps = np.diff(stream.ordered.stamp_ns) / NS_PER_S
        if stream.topic == 'tire_samples':
            yield from _lost_batches(stream, steps)
            continue
        long = steps > max(MAX_GAP[stream.topic], MIN_GAP_PERIODS * stream.period)
        if long.any():
            at = (stream.ordered.stamp_ns[:-1][long][0] - recording.origin_ns) / NS_PER_S
            yield Finding(Level.WARNING, stream.name, f'{counted(long.sum(), "gap")}, the longest '
                          f'{steps.max():.3g} s, the first at {at:.1f} s',
                          f'none above {MAX_GAP[stream.topic]:g} s',
                          'check the cable and the load of the host')


def _lost_batches(stream: Stream, steps: Array) -> Iterator[Finding]:
    long = steps > BATCH_GAP_PERIODS * stream.period
    missing = float(np.sum(np.rint(steps[long] / stream.period) - 1.0))
    share = missing / (missing + len(stream.stamp_ns))
    if long.any():
        yield Finding(
            Level.WARNING if share > MAX_LOST_SHARE else Level.INFO, stream.name,
            f'{share:.1%} of the samples are missing, in {counted(long.sum(), "gap")}',
            f'at most {MAX_LOST_SHARE:.0%}' if share > MAX_LOST_SHARE else '',
            'radio batches were lost: move the antenna, change the channel'
            if share > MAX_LOST_SHARE else '')


def check_stamps(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield timestamps that are zero, run backwards or repeat."""
    for stream in (one for topic in INPUTS for one in recording.of(topic)):
        count, steps = len(stream.stamp_ns), np.diff(stream.stamp_ns)
        zero, back, same = ((stream.stamp_ns <= 0).sum(), (steps < 0).sum(),
                            (steps == 0).sum() * (stream.stamp_ns > 0).any())
        if zero:
            yield Finding(Level.ERROR, stream.name, f'{zero} of {count} timestamps are zero',
                          'the time of the measurement', 'set header.stamp in the driver')
        if back:
            yield Finding(Level.WARNING, stream.name,
                          f'{counted(back, "timestamp")} before the previous one, by up to '
                          f'{-steps.min() / NS_PER_S:.3g} s', 'ascending timestamps',
                          'late samples are dropped: check clock steps and several publishers')
        if same and not zero:
            yield Finding(Level.WARNING, stream.name, counted(same, 'repeated timestamp'),
                          'one message per timestamp', 'check for a second publisher')


def check_jitter(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield irregular timestamps: those of arrival instead of measurement."""
    for stream in _regular(recording):
        steps = np.diff(stream.ordered.stamp_ns) / NS_PER_S
        jitter = MAD_TO_SIGMA * float(np.median(np.abs(steps - stream.period))) / stream.period
        if jitter > MAX_JITTER:
            yield Finding(Level.WARNING, stream.name, f'periods of the timestamps vary by '
                          f'{jitter:.0%}', f'at most {MAX_JITTER:.0%}',
                          'stamp the measurement instead of the arrival')


def check_delays(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield timestamps far from reception, and inputs whose clocks differ."""
    medians: dict[str, float] = {}
    for stream in _stamped(recording):
        delay = medians[stream.name] = float(np.median(_delays(stream)))
        if delay < -MAX_LEAD:
            yield Finding(Level.WARNING, stream.name, f'timestamps are {-delay:.3g} s after their '
                          'reception', 'before it', 'synchronize the clocks (chrony)')
        elif delay > MAX_DELAY:
            yield Finding(Level.WARNING, stream.name, f'timestamps are {delay:.3g} s before their '
                          'reception', f'at most {MAX_DELAY:g} s', 'stamp with the clock of the '
                          'host, not with that of the device')
    if medians and max(medians.values()) - min(medians.values()) > MAX_CLOCK_DIFFERENCE:
        late, early = max(medians, key=medians.__getitem__), min(medians, key=medians.__getitem__)
        yield Finding(Level.ERROR, late, f'timestamps are {medians[late] - medians[early]:.3g} s '
                      f'behind those of {early}', 'one clock for all inputs',
                      'synchronize the clocks of their drivers')


def check_drift(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield clocks of timestamps that drift against the clock of the recorder."""
    for stream in _stamped(recording):
        drift = _drift(stream)
        if drift is not None and abs(drift[0]) > max(MAX_DRIFT, SIGMAS * drift[1]) and (
                abs(drift[0]) * drift[2] > MIN_DRIFT_CHANGE):
            yield Finding(Level.WARNING, stream.name, f'timestamps drift by {drift[0] * 1e6:+.0f} '
                          f'+- {drift[1] * 1e6:.0f} us/s against their reception',
                          f'less than {MAX_DRIFT * 1e6:.0f} us/s',
                          'map the time of the device to that of the host')


def _drift(stream: Stream) -> tuple[float, float, float] | None:
    """Return drift of the timestamps [s/s], standard error and time span [s]."""
    time = (stream.receive_ns - stream.receive_ns[0]) / NS_PER_S
    span = float(time[-1])
    if span < MIN_DRIFT_TIME:
        return None
    delay, block = _delays(stream), np.minimum(
        (time / span * DRIFT_BLOCKS).astype(int), DRIFT_BLOCKS - 1)
    used = [index for index in range(DRIFT_BLOCKS) if (block == index).any()]
    lowest = np.array([delay[block == index].min() for index in used])
    center = (np.array(used) + 0.5) * span / DRIFT_BLOCKS
    i, j = np.triu_indices(len(used), 1)
    if not len(i):
        return None
    slope = float(np.median((lowest[j] - lowest[i]) / (center[j] - center[i])))  # Theil and Sen
    residual = lowest - np.median(lowest - slope * center) - slope * center
    sigma = MAD_TO_SIGMA * float(np.median(np.abs(residual)))
    spread = float(np.sqrt(np.sum((center - center.mean()) ** 2)))
    return -slope, sigma / spread, span


def check_held(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield IMU samples that repeat the previous one."""
    imu = recording.imu
    if imu is None or len(imu.ordered) < MIN_MESSAGES:
        return
    share = float((np.diff(imu.ordered.values[:, :6], axis=0) == 0.0).all(axis=1).mean())
    if share > MAX_HELD_SHARE:
        yield Finding(Level.WARNING, imu.name, f'{share:.0%} of the samples repeat the one before',
                      'a measurement per message', f'the device delivers only '
                      f'{(1.0 - share) / imu.period:.3g} Hz: publish each measurement once')


def _regular(recording: CheckedRecording) -> list[Stream]:
    return [stream for topic in INPUTS for stream in recording.of(topic)
            if len(stream.ordered) >= MIN_MESSAGES]


def _stamped(recording: CheckedRecording) -> list[Stream]:
    return [stream for stream in _regular(recording) if (stream.stamp_ns > 0).all()]


def _delays(stream: Stream) -> Array:
    return np.asarray((stream.receive_ns - stream.stamp_ns) / NS_PER_S)
