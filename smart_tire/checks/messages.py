# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Checks of the messages: topics, frames, rates, gaps and timestamps.

The delay of a message is its receive time minus its timestamp. Its smallest values vary little, so
their change over the recording shows clocks that drift against each other.
"""

from __future__ import annotations

from collections.abc import Iterator
import math
import re

import numpy as np

from smart_tire.checks import limits
from smart_tire.checks.recording import CheckedRecording, finding
from smart_tire.checks.stalls import delays, due_ns, least_delays, NO_MESSAGE, runs
from smart_tire.estimation.streams import INPUTS
from smart_tire.findings import counted, Finding, Level
from smart_tire.host_load import FACTOR, other_problems
from smart_tire.messages import NANOSEC, TOPICS
from smart_tire.numerics.robust import MAD_TO_SIGMA
from smart_tire.parameters import NODE_PARAMS
from smart_tire.recording import Stream
from smart_tire.samples import FIRST_DATE_NS, NS_PER_S

RECORDER = 'recorder'  # node of smart_tire record
STAMP_UNITS = {'milliseconds': 1e6, 'microseconds': 1e3}  # ns
NEEDED_FOR = {'imu/data': 'odom and wheel_slip', 'wheel_states': 'all estimates',
              'tire_samples': 'tire_friction'}


def check_host(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield that the host was late; what this explains is not reported by the other checks."""
    stalls, reported = recording.stalls, recording.stalls.reported
    if reported is not None and reported.late:
        if recording.host is None and not any(
                FACTOR in status.values for _, status in recording.statuses):  # its time waits
            yield finding('host_late', 'host', host=reported)
    elif stalls.shared:
        begin, duration = stalls.spans().T
        waited = reported is None or 2.0 * reported.longest > duration.max()
        devices = dict.fromkeys(name for pair in stalls.shared for name in pair)
        yield finding('host_stalled', 'host', devices=', '.join(devices),
                      count=counted(len(begin), 'time'), longest=duration.max(),
                      first=begin[0] - (recording.origin_ns - stalls.start_ns) / NS_PER_S,
                      action='end other programs' if waited else 'no node waited for a core: '
                      'check the disk of the recorder, and the network to it')


def check_topics(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield missing inputs; with films expected, missing films are a warning."""
    has, way_on = recording.contents
    for name in INPUTS:
        films = name == 'tire_samples'
        if (recording.of(name) or recording.faults.rejected[name]
                or films and not recording.robot.film.wheels):
            continue
        yield finding('input_missing', name, Level.WARNING if films else None,
                      type=TOPICS[name].type, needed=NEEDED_FOR[name],
                      contents=f'; {has}' * bool(has and not films),
                      action=way_on if way_on and not films else 'record this topic')
        has = way_on = ''


def check_problems(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield damage of the bag and topics of another type."""
    for text in recording.problems:
        yield finding('problem', 'bag', text=text)


def check_rejected(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield topics with invalid messages, and the first reason."""
    for topic, count in recording.faults.rejected.items():
        total = count + sum(map(len, recording.of(topic)))
        yield finding('rejected', topic,
                      Level.ERROR if count > limits.MAX_REJECTED_SHARE * total else None,
                      count=count, total=total,
                      reason=recording.faults.reasons[topic].removeprefix(f'{topic}: '))


def check_frames(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield unexpected frames; those of imu/data matter if TF is used, others are ignored."""
    for topic, frames in sorted(recording.faults.frames.items()):
        expected = recording.robot.frames.get(TOPICS[topic].frame, TOPICS[topic].frame)
        for frame, count in frames.items():
            if expected and frame.rpartition('/')[2] != expected.rpartition('/')[2]:
                yield finding('frame', topic, frame=frame, count=count, expected=expected, action=(
                    'not used by the estimators: imu.position and imu.rotation describe the '
                    'mounting' if topic == 'imu/data' else ''))


def check_film_wheels(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield configured wheels without samples, samples of other wheels, other film counts."""
    streams, film = recording.of('tire_samples'), recording.robot.film
    found = [stream.wheel for stream in streams]
    for wheel in film.wheels if streams else ():
        if wheel not in found:
            yield finding('film_wheel_missing', f'tire_samples of {wheel}', wheel=wheel)
    for stream in streams:
        if stream.wheel not in film.wheels:
            yield finding('film_wheel_unused', stream.name, wheels=list(film.wheels),
                          wheel=stream.wheel)
        elif stream.values.shape[1] != film.count:
            yield finding('film_count', stream.name, found=stream.values.shape[1],
                          count=film.count)


def check_columns(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield that no torques or positions were recorded: slip is then less accurate."""
    wheels = recording.wheels
    if len(wheels) and np.isnan(wheels['effort']).all():
        yield finding('no_torques', wheels.name)
    if len(wheels) and np.isnan(wheels['position']).any():
        yield finding('no_positions', wheels.name)


def check_clock_steps(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield clocks that were set while the bag was recorded, and times without any reception."""
    for text in recording.faults.clock_steps:
        yield finding('clock_set', 'clock', text=text)
    for begin_ns, end_ns, turned in recording.faults.pauses:
        yield finding(
            'interrupted', 'bag', duration=(end_ns - begin_ns) / NS_PER_S,
            first=(begin_ns - recording.origin_ns) / NS_PER_S,
            turned=', while the wheels turned on' * turned, cause='the recording was interrupted'
            + (not turned) * ', or the clock was set forward while the robot stood still')


def check_completed(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield what ``wheel_states`` lacked and was completed from its other fields."""
    for kind, count in sorted(recording.faults.completed.items()):
        if count:
            # a few, rounded or at starts, are no error
            rare = kind == 'zero_velocity' and count <= (
                limits.MAX_MISSED_SHARE * len(recording.wheels))
            yield finding(kind, 'wheel_states', Level.INFO if rare else None,
                          count=counted(count, 'message'))


def check_covariances(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield values of the IMU that its messages call not measured."""
    if found := recording.faults.contradictions:
        yield finding('covariance', 'imu/data', fields=' and '.join(sorted(found)),
                      count=counted(max(found.values()), 'message'))


def check_rates(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield rates below what the estimators need, and rates that differ from the nominal one."""
    for stream in recording.regular:
        rate, films = 1.0 / stream.period, stream.topic == 'tire_samples'
        nominal = recording.robot.film.sample_rate if films else TOPICS[stream.topic].rate
        least = limits.MIN_RATE.get(stream.topic, 0.0)
        deviation = abs(rate / nominal - 1.0)
        kind = ('film_rate' if films and deviation > limits.FILM_RATE_TOLERANCE else
                'low_rate' if rate < 0.9 * least else
                'other_rate' if deviation > limits.RATE_TOLERANCE else 'rate')
        yield finding(kind, stream.name, rate=rate, nominal=nominal, least=least,
                      count=len(stream))


def check_gaps(recording: CheckedRecording) -> Iterator[Finding]:
    """
    Yield gaps between timestamps; in film samples these are lost radio batches.

    Those in stalls of the host are left out, also from the share of the lost batches.
    """
    for stream in recording.regular:
        ordered, due = stream.ordered, due_ns(stream.ordered)
        films = stream.topic == 'tire_samples'
        limit = 0.0 if films else 2.0 / limits.MIN_RATE[stream.topic]
        steps = np.diff(ordered.stamp_ns) / NS_PER_S
        gap = steps > max(limit, limits.MIN_GAP_PERIODS * stream.period)
        gap &= ~recording.stalls.explain(due[:-1], due[1:])
        missing = np.sum(np.rint(steps[gap] / stream.period) - 1.0)
        if missing <= recording.faults.rejected[stream.topic]:  # also without a gap
            continue
        if films:
            share = missing / (missing + np.sum(~recording.stalls.explain(due, due)))
            limit = limits.MAX_MISSED_SHARE
            yield finding('many_lost_batches' if share > limit else 'lost_batches', stream.name,
                          share=share, count=counted(int(gap.sum()), 'gap'), limit=limit)
        else:
            yield finding('gap', stream.name, count=counted(int(gap.sum()), 'gap'), limit=limit,
                          longest=steps[gap].max(), first=(
                              ordered.stamp_ns[:-1][gap][0] - recording.origin_ns) / NS_PER_S)


def check_stamps(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield timestamps that are zero, of another unit, run backwards or repeat."""
    for name, ratio in recording.invalid_stamps.items():
        if not math.isnan(ratio):  # else the messages are rejected
            yield finding('stamp_unit', name, reason=next(
                (f'{NANOSEC} has {unit}' for unit, factor in STAMP_UNITS.items()
                 if 0.5 < ratio / factor < 2.0), f'{NANOSEC} does not advance'))
    for stream in (one for topic in INPUTS for one in recording.of(topic)
                   if one.name not in recording.invalid_stamps):
        steps = np.diff(stream.stamp_ns)
        zero, back, same = (stream.stamp_ns <= 0).sum(), (steps < 0).sum(), (steps == 0).sum()
        if zero:
            yield finding('stamp_zero', stream.name, zero=zero, count=len(stream))
        if back:
            yield finding('stamp_back', stream.name, count=counted(back, 'timestamp'),
                          most=-steps.min() / NS_PER_S)
        if same and not zero:
            yield finding('stamp_repeated', stream.name,
                          count=counted(same, 'repeated timestamp'))


def check_publishers(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield two publishers of imu/data, which measure different forces."""
    share = other_share(recording.imu.ordered)
    if share > limits.MAX_OTHER_SHARE:
        frames = list(recording.faults.frames.get('imu/data', ()))
        yield finding('two_publishers', recording.imu.name, share=share, frames=(
            f' (header.frame_id {" and ".join(frames)})' if len(frames) > 1 else ''))


def other_share(imu: Stream) -> float:
    """Return the share of the samples that differ from both neighbors, which agree."""
    if len(imu) < limits.MIN_READINGS:
        return 0.0
    force = imu['acceleration']
    before, after = (np.linalg.norm(one, axis=1) for one in (
        force[1:-1] - force[:-2], force[2:] - force[1:-1]))
    around = np.linalg.norm(force[2:] - force[:-2], axis=1)
    apart = np.minimum(before, after) > limits.OTHER_FACTOR * (around + np.median(around))
    return float(apart.mean())


def check_jitter(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield irregular timestamps: those of arrival, of a host that was not late."""
    for stream in () if recording.stalls.late else recording.regular:
        steps = np.diff(stream.ordered.stamp_ns) / NS_PER_S
        jitter = MAD_TO_SIGMA * float(np.median(np.abs(steps - stream.period))) / stream.period
        if jitter > limits.MAX_JITTER:
            yield finding('jitter', stream.name, jitter=jitter, limit=limits.MAX_JITTER)


def check_delays(recording: CheckedRecording) -> Iterator[Finding]:
    """
    Yield timestamps far from reception, and inputs whose clocks differ.

    A recorder that is late on a late host delays all devices, each at least as the promptest.
    """
    medians = _median_delays(recording)
    if medians and max(medians.values()) - min(medians.values()) <= limits.MAX_DELAY:
        simulated = [(stream.stamp_ns[0] < FIRST_DATE_NS, stream.receive_ns[0] < FIRST_DATE_NS)
                     for stream in recording.stamped]
        if all(one == (True, False) for one in simulated):
            yield finding('simulated_time', 'host')
            return
        if all(one == (False, True) for one in simulated):
            yield finding('simulated_reception', 'host')
            return
    common = min(medians.values()) if recording.stalls.late and len(
        {stream.topic for stream in recording.stamped}) > 1 else 0.0
    for stream in recording.stamped:
        delay = medians[stream.name] - max(common, 0.0)
        if not -limits.MAX_LEAD <= delay <= limits.MAX_DELAY:
            yield finding('stamp_ahead' if delay < 0.0 else 'stamp_behind', stream.name,
                          lead=-delay, delay=delay, limit=limits.MAX_DELAY)
    if medians and max(medians.values()) - min(medians.values()) > limits.MAX_DELAY:
        late, early = max(medians, key=medians.__getitem__), min(medians, key=medians.__getitem__)
        yield finding('clocks_differ', late, difference=medians[late] - medians[early],
                      other=early)


def _median_delays(recording: CheckedRecording) -> dict[str, float]:
    return {stream.name: float(np.median(delays(stream))) for stream in recording.stamped}


def clock_differences(recording: CheckedRecording) -> dict[str, float]:
    """Return by how much [s] the clock of each input is behind; nothing if they agree."""
    medians = _median_delays(recording)
    prompt = min(medians.values(), default=0.0)
    late = {name: delay - prompt for name, delay in medians.items()}
    return late if max(late.values(), default=0.0) > limits.MAX_DELAY else {}


def check_late(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield messages that arrived late, compared with the promptest ones around them."""
    for stream in recording.stamped:
        due = due_ns(stream)
        lateness = (stream.receive_ns - due) / NS_PER_S
        late = lateness > limits.MAX_LATENESS
        late &= ~recording.stalls.explain(due, stream.receive_ns)
        if late.any():
            yield finding('late', stream.name, count=int(late.sum()), total=len(stream),
                          limit=limits.MAX_LATENESS, longest=lateness[late].max(),
                          first=(stream.stamp_ns[late][0] - recording.origin_ns) / NS_PER_S)


def check_diagnostics(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield warnings and errors that nodes have published."""
    found: dict[tuple[str, int, str], list[tuple[int, str]]] = {}
    for stamp_ns, status in recording.statuses:
        text = other_problems(status.message, status.values, late=recording.stalls.late)
        if status.level and text and status.name.rpartition('/')[2] in (*NODE_PARAMS, RECORDER):
            kind = status.name, status.level, re.sub(r'[0-9.]+', '', text)
            found.setdefault(kind, []).append((stamp_ns, text))
    for (node, level, _), texts in found.items():
        severity = (Level.INFO if len(texts) < limits.MIN_WARNINGS else
                    Level.WARNING if level == 1 else Level.ERROR)
        yield finding('diagnostics', node, severity, text=texts[-1][1],
                      times=counted(len(texts), 'time'),
                      first=(texts[0][0] - recording.origin_ns) / NS_PER_S)


def check_drift(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield clocks of timestamps that drift against the receptions, unless these are late."""
    for stream in () if recording.stalls.late else recording.stamped:
        span = float(np.ptp(stream.receive_ns)) / NS_PER_S
        if (found := _drift(stream)) is None:
            continue
        drift, sigma = found
        if abs(drift) > max(limits.MAX_DRIFT, limits.SIGMAS * sigma,
                            limits.MIN_DRIFT_CHANGE / span):
            yield finding('drift', stream.name, drift=drift * 1e6, sigma=sigma * 1e6,
                          limit=limits.MAX_DRIFT * 1e6)


def check_held(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield IMU samples that repeat the previous one."""
    imu = recording.imu
    if len(imu.ordered) < limits.MIN_READINGS:
        return
    repeated = (np.diff(imu.ordered.values[:, :6], axis=0) == 0.0).all(axis=1)
    begin, end = runs(repeated)  # a simulator without noise repeats for longer
    count = end - begin
    count = count[count * imu.period < limits.MAX_HELD_TIME]
    share = float(count.sum()) / len(repeated)
    if share > limits.MAX_MISSED_SHARE and recording.imu.name not in recording.invalid_stamps:
        yield finding('held', imu.name, share=share, rate=(1.0 - share) / imu.period)


def _drift(stream: Stream) -> tuple[float, float] | None:
    """Return drift of the timestamps [s/s] and its standard error; None if not observable."""
    _, least = least_delays(stream)
    used = np.flatnonzero(least != NO_MESSAGE)
    if len(used) < 3:
        return None
    lowest = least[used] / NS_PER_S
    span = float(stream.receive_ns[-1] - stream.receive_ns[0]) / NS_PER_S
    center = (used + 0.5) * span / limits.DRIFT_BLOCKS
    i, j = np.triu_indices(len(used), 1)
    slope = float(np.median((lowest[j] - lowest[i]) / (center[j] - center[i])))  # Theil and Sen
    residual = lowest - np.median(lowest - slope * center) - slope * center
    sigma = MAD_TO_SIGMA * float(np.median(np.abs(residual)))
    spread = float(np.sqrt(np.sum((center - center.mean()) ** 2)))
    return -slope, sigma / spread
