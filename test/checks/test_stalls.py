# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A late host is one finding, without its consequences; a lost radio or cable is no late host."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from benchmarks.faults import interrupted, stalled
import numpy as np
import pytest
from smart_tire.checks import findings, limits, messages
from smart_tire.checks.recording import CheckedRecording
from smart_tire.checks.stalls import due_ns, stalled_intervals, Stalls
from smart_tire.findings import Level
from smart_tire.host_load import EXPLAINED, HostLoad, KEYS
from smart_tire.messages import NodeStatus
from smart_tire.parameters import RobotParams
from smart_tire.recording import SampleArrays
from smart_tire.samples import ImuSample, NS_PER_S, TireSample, WheelSample
from smart_tire.simulation.offline import EPOCH_NS
from support.checked import clean, recording, texts

SPANS = [(4.0, 4.6), (7.5, 7.9), (13.0, 13.5), (17.2, 18.2)]  # s
BUFFER = 0.2  # s of radio batches that a serial port holds
LATE = HostLoad(0.031, 0.6, 36.0, 2)
DATA = Path(__file__).parents[1] / 'data' / 'starved'
SAID = 'host: timers late by 31 ms (99%), load 36.0 on 2 cores: end other programs'


def starved(events, spans=SPANS):
    """
    Return ``events`` of drivers that wait for a core in ``spans``.

    The IMU is read late; wheels are not read; the port of the radio overflows.
    """
    start, found = events[0][0], []
    for receive_ns, topic, sample in events:
        due = (receive_ns - start) / NS_PER_S
        begin, end = next((span for span in spans if span[0] <= due < span[1]), (due, due))
        if begin < end and (topic == 'wheel_states'
                            or topic == 'tire_samples' and due > begin + BUFFER):
            continue
        found.append((receive_ns + round((end - due) * NS_PER_S), topic, sample))
    return sorted(found, key=lambda event: event[0])


def reported(events, *loads, explained=''):
    """Return the recording of ``events`` with the ``loads`` in the diagnostics of each second."""
    return replace(recording(events), statuses=tuple(
        (EPOCH_NS + second * NS_PER_S, NodeStatus(
            'slip_estimator', int(bool(explained)), explained or 'ok',
            {EXPLAINED: explained, **{key: str(value) for key, value in load.values.items()}}))
        for load in loads for second in range(1, 24)))


def warnings(checked):
    return [one.text for one in findings(checked) if one.level >= Level.WARNING]


def lossy(events, share, topic='tire_samples', seed=3):
    """Return ``events`` without a ``share`` of the batches of each wheel, lost by the radio."""
    rng, last, lost, kept = np.random.default_rng(seed), {}, {}, []
    for receive_ns, name, sample in events:
        if name == topic:
            wheel = sample.wheel
            if last.get(wheel) != receive_ns:
                last[wheel], lost[wheel] = receive_ns, rng.random() < share
            if lost[wheel]:
                continue
        kept.append((receive_ns, name, sample))
    return kept


@pytest.mark.parametrize('make', [stalled, starved])
def test_a_late_host_without_diagnostics_is_the_only_warning(make):
    """It is found by the stalls of independent devices at the same time."""
    text, = warnings(recording(make(clean(), SPANS)))
    assert text == (
        'host: imu/data, wheel_states, tire_samples stalled 4 times at the same time, up to '
        '1.0 s, the first at 4.0 s: the host or the recorder was late; end other programs')


@pytest.mark.parametrize('make', [stalled, starved])
def test_a_late_host_that_nodes_have_reported_is_the_only_warning(make):
    assert warnings(reported(make(clean(), SPANS), LATE)) == [SAID]


def test_a_reported_host_explains_the_stalls_of_a_single_device():
    gaps = interrupted(clean(), 'imu/data', SPANS)
    assert warnings(reported(gaps, LATE)) == [SAID]
    assert [text[:16] for text in warnings(reported(gaps, replace(LATE, typical=0.019)))] == [
        'imu/data: 4 gaps']


@pytest.mark.parametrize('loads', [(), (LATE,), (replace(LATE, typical=0.001),)])
def test_lost_batches_between_punctual_ones_are_those_of_the_radio(loads):
    found = warnings(reported(lossy(clean(), 0.3), *loads))
    assert found[:len(found) - 1] == [SAID] * (loads == (LATE,))
    assert found[-1].startswith('tire_samples of front_right: ')
    assert found[-1].endswith('move the antenna, change the channel')


@pytest.mark.parametrize('loads', [(), (LATE,)])
def test_a_lossy_radio_on_a_late_host_is_blamed_for_its_own_share(loads):
    """The share is that of the time without stalls, here half of the recording."""
    spans = [(begin, begin + 1.2) for begin in np.arange(2.0, 22.0, 2.0)]
    found = warnings(reported(starved(lossy(clean(), 0.3), spans), *loads))
    assert [text.partition(':')[0] for text in found] == ['host', 'tire_samples of front_right']
    share = float(found[1].partition(': ')[2].partition('%')[0])
    assert share == pytest.approx(30.0, abs=5.0)


def test_losses_in_stalls_do_not_make_a_good_radio_a_bad_one():
    assert 'INFO tire_samples of front_right: 2' in texts(messages.check_gaps(
        recording(starved(lossy(clean(), 0.02)))))


@pytest.mark.parametrize('topic, name', [
    ('tire_samples', 'tire_samples of front_right'), ('imu/data', 'imu/data'),
    ('wheel_states', 'wheel_states')])
def test_one_device_that_is_late_alone_is_named(topic, name):
    alone = [event for event in clean() if event[1] == topic]
    others = [event for event in clean() if event[1] != topic]
    found = warnings(recording(sorted(
        [*stalled(alone, SPANS), *others], key=lambda event: event[0])))
    assert [text.partition(':')[0] for text in found] == [name]
    assert 'check the link and the driver' in found[0]


def test_stalls_of_devices_at_other_times_are_not_those_of_the_host():
    events = interrupted(clean(), 'imu/data', [(3.0, 3.4), (8.0, 8.4)])
    events = interrupted(events, 'wheel_states', [(5.0, 5.9), (14.0, 14.9)])
    assert [text.partition(':')[0] for text in warnings(recording(events))] == [
        'imu/data', 'wheel_states']


@pytest.mark.parametrize('longest, action', [
    (0.6, 'end other programs'), (0.4, 'no node waited for a core: check the disk of the '
                                  'recorder, and the network to it')])
def test_stalls_for_which_no_node_has_waited_are_those_of_disk_or_network(longest, action):
    """The longest of them takes a second; driver and recorder may both wait."""
    load = HostLoad(0.001, longest, 1.0, 2)
    text, = warnings(reported(stalled(clean(), SPANS), load))
    assert text.endswith(f'late; {action}')


def backlogged(events, delay, growth, devices):
    """Return ``events`` of ``devices`` received with a delay [s] that grows [s/s]."""
    start = events[0][0]
    return sorted(((receive_ns + (topic in devices) * (
        round(delay * NS_PER_S) + round(growth * (receive_ns - start))), topic, sample)
        for receive_ns, topic, sample in events), key=lambda event: event[0])


ALL = 'imu/data', 'wheel_states', 'tire_samples'


@pytest.mark.parametrize('loads, devices, said', [
    ((LATE,), ALL, []), ((), ALL, ['timestamps are', 'timestamps drift'] * 3),
    ((LATE,), ['imu/data'], ['timestamps are', 'timestamps are'])])
def test_all_devices_are_received_late_by_a_recorder_that_is_late(loads, devices, said):
    """One device alone is late by itself; its clock differs from those of the others, too."""
    found = warnings(reported(backlogged(clean(), 0.8, 0.01, devices), *loads))
    assert found[:1] == [SAID] * bool(loads) or not loads
    rest = [' '.join(text.partition(': ')[2].split()[:2]) for text in found if text != SAID]
    assert sorted(rest) == sorted(said)


def test_irregular_timestamps_on_a_late_host_are_those_of_arrivals():
    rng = np.random.default_rng(5)
    events = [(receive_ns, topic, replace(sample, stamp_ns=sample.stamp_ns + round(
        rng.normal(0.0, 5e6))) if topic == 'imu/data' else sample)
        for receive_ns, topic, sample in clean()]
    jitters = [list(messages.check_jitter(reported(events, *loads))) for loads in ((), (LATE,))]
    assert list(map(len, jitters)) == [1, 0]


def test_what_a_late_host_explains_is_not_reported_of_nodes():
    text = '4 messages dropped: older than reorder_window'
    assert warnings(reported(clean(), LATE, explained=text)) == [SAID]
    found, = warnings(reported(clean(), replace(LATE, typical=0.001), explained=text))
    assert found == f'slip_estimator: {text} (23 times, the first at 1.0 s)'


def test_a_stall_is_waiting_of_a_message_or_a_gap_of_imu_and_wheels():
    begin_ns = clean()[0][0]
    for topic in ('imu/data', 'wheel_states', 'tire_samples'):
        checked = recording(interrupted(clean(), topic, [(10.0, 10.5)]))
        found = [interval for stream in checked.stamped
                 for interval in zip(*np.hstack(stalled_intervals(stream)))]
        if topic == 'tire_samples':
            assert found == []
        else:
            (first, last), = found
            assert (first - begin_ns) / NS_PER_S == pytest.approx(10.0, abs=0.07)
            assert (last - begin_ns) / NS_PER_S == pytest.approx(10.5, abs=0.07)


@pytest.mark.parametrize('late, count', [(0.9, 0), (1.1, 1)])
def test_a_message_waits_from_when_it_was_due_to_its_reception(late, count):
    delay_ns = round(late * limits.MIN_STALL * NS_PER_S)
    events = list(clean())
    index = next(i for i, one in enumerate(events) if one[1] == 'imu/data' and i > 5000)
    events[index] = (events[index][0] + delay_ns, *events[index][1:])
    stream = recording(events).imu
    (begin, end), _ = stalled_intervals(stream)
    assert len(begin) == count
    assert np.all(np.abs(end - begin - delay_ns) < 1e6)


def test_intervals_are_explained_by_overlapping_stalls_only():
    checked = recording(stalled(clean(), [(10.0, 10.5)]))
    stalls, start_ns = checked.stalls, clean()[0][0]
    (begin, duration), = stalls.spans()
    assert begin + (stalls.start_ns - start_ns) / NS_PER_S == pytest.approx(10.0, abs=0.07)
    assert duration == pytest.approx(0.5, abs=0.12)
    times = np.array([(9.0, 9.8), (9.8, 10.2), (10.2, 10.3), (10.3, 12.0), (10.7, 12.0)])
    explained = stalls.explain(*(start_ns + np.rint(times.T * NS_PER_S).astype(np.int64)))
    assert explained.tolist() == [False, True, True, True, False]
    edges = np.array([(-1.0, -0.005), (-1.0, 0.005), (duration - 0.005, 9.0),
                      (duration + 0.005, 9.0)])
    touching = stalls.explain(*(stalls.start_ns + np.rint(
        (begin + edges.T) * NS_PER_S).astype(np.int64)))
    assert touching.tolist() == [False, True, True, False]


def test_recordings_without_stamped_messages_have_no_stalls():
    stalls = Stalls([])
    assert not stalls.late and len(stalls.spans()) == 0
    assert not stalls.explain(np.array([1]), np.array([2])).any()
    single = recording([event for event in clean() if isinstance(event[2], TireSample)])
    assert not single.stalls.late
    assert (due_ns(single.stamped[0]) <= single.stamped[0].receive_ns).all()


SAMPLES = {'imu/data': lambda ns: ImuSample(ns, (0.0, 0.0, 9.81), (0.0, 0.0, 0.0)),
           'wheel_states': lambda ns: WheelSample(ns, (0.0,) * 4, (0.0,) * 4),
           'tire_samples.front_left': lambda ns: TireSample(ns, 'front_left', (1.65, 1.65)),
           'tire_samples.front_right': lambda ns: TireSample(ns, 'front_right', (1.65, 1.65))}
TIMED = [getattr(messages, f'check_{name}')
         for name in ('host', 'gaps', 'late', 'diagnostics', 'jitter', 'delays', 'drift')]


def recorded(name):
    """Return the times of a recording on a host that was late, and what nodes have reported."""
    samples, statuses = SampleArrays(), []
    with np.load(DATA / f'{name}.npz') as file:
        for stream, sample in SAMPLES.items():
            stamps, delays = 1000 * np.cumsum(file[stream], axis=1, dtype=np.int64)
            for stamp, delay in zip(EPOCH_NS + stamps, delays):
                samples.add_sample(sample(int(stamp)), int(stamp + delay))
        for time, *load in file['host'].tolist():
            statuses.append((EPOCH_NS + round(time * NS_PER_S), NodeStatus(
                'recorder', 0, 'ok', dict(zip(KEYS, map(str, load))))))
    return CheckedRecording(RobotParams(), samples, statuses=tuple(statuses))


@pytest.mark.parametrize('name, devices, typical', [
    ('stall', 'imu/data, wheel_states, tire_samples', 142),
    ('busy', 'wheel_states, tire_samples', 814)])
def test_a_recorded_late_host_is_the_only_finding(name, devices, typical):
    """What is left are the batches that the simulated radio has dropped."""
    for checked, said in ((recorded(name), f'timers late by {typical} ms (99%), load '),
                          (replace(recorded(name), statuses=()), f'{devices} stalled 1 time')):
        found = [one for check in TIMED for one in check(checked)]
        assert found[0].where == 'host' and found[0].found.startswith(said)
        assert [one.level for one in found[1:]] == [Level.INFO]
        assert found[1].where.startswith('tire_samples') and found[1].found.startswith('0.')
