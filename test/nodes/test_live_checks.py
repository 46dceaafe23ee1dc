# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What a running ``slip_estimator`` says of inputs that contradict each other or themselves."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
import os
import pickle
import subprocess
import sys
from threading import Event

from benchmarks.strangers import ALL, DRIVE, DURATION, NO_LOAD
from benchmarks.wrong_data import CHANGED, encoded, Variant
import pytest
from rclpy.serialization import deserialize_message
from smart_tire.checks.live import errors_of
from smart_tire.messages import TOPICS
from smart_tire.nodes.compat import message_class
from smart_tire.nodes.live_checks import (
    in_process, in_thread, LiveChecks, MAX_SHARE, PERIOD, PROGRAM, WINDOW)
from smart_tire.nodes.slip_estimator import SlipEstimatorNode
from smart_tire.parameters import RobotParams
from smart_tire.parameters.robot import TreadFilmParams
from smart_tire.samples import ImuSample, NS_PER_S, WheelSample
from support.checked import clean
from support.virtual_node import virtual
from support.waiting import PATIENCE, wait_for

pytestmark = pytest.mark.processes

ROBOT = RobotParams(film=TreadFilmParams(wheels=()))


def at_once(*job):
    """Return the errors that a check finds, in no time."""
    return errors_of(*job), 0.0


@pytest.fixture(scope='module')
def events():
    """Return a drive with turns, starts and stops."""
    return [event for event in clean(1, 'concrete', DRIVE, 16.0, ROBOT) if event[1] in CHANGED]


def drive(node, events, variant):
    """Hand the messages of a variant of a drive to a node; its checks are made at once."""
    node.checks = LiveChecks(node.params.robot, lambda work: work(), at_once)
    ahead_ns = node.now_ns() - events[0][0]
    now = [(at + ahead_ns, topic, replace(sample, stamp_ns=sample.stamp_ns + ahead_ns))
           for at, topic, sample in events]
    said = Counter()
    for at, topic, sample in variant.change(now, ROBOT):
        while at - node.now_ns() > NS_PER_S / 2:
            node.run(0.5)
        node.elapsed_ns += max(0, at - node.now_ns())
        node.publish(topic, deserialize_message(
            encoded(topic, sample, variant), message_class(TOPICS[topic].type)))
        if topic == 'wheel_states':
            said.update(node.health().message.split('; '))
    node.run(PERIOD)
    said.update(node.health().message.split('; '))
    return '; '.join(said)


@pytest.mark.parametrize('name', [
    'gyro in deg/s', 'accelerometer in g', 'wheel speeds in rpm', 'IMU turned by 90 degrees',
    'sides swapped', 'right wheels reversed', 'velocities always zero', 'two IMUs',
    'IMU stuck in the second half', 'milliseconds in nanosec', 'gyro not measured',
    'clock set forward by an hour'])
def test_the_diagnostics_say_what_doctor_says_of_a_recording(
        name, events, isolated_ros, monkeypatch):
    variant = ALL[name]
    # one check, of the whole drive, as doctor makes it: each takes a second
    monkeypatch.setattr('smart_tire.nodes.live_checks.PERIOD', DURATION)
    with virtual(SlipEstimatorNode, '-p', 'film.wheels:=[]') as node:
        said = drive(node, events, variant)
        log = '\n'.join(node.log.lines)
    cause = ('the clock of the inputs was set',) if name.startswith('clock') else variant.cause
    assert [part for part in cause if part not in said] == [], said
    assert [part for part in cause if part not in log] == [], log


def test_the_drive_itself_has_no_error(events, isolated_ros):
    with virtual(SlipEstimatorNode, '-p', 'film.wheels:=[]') as node:
        drive(node, events, Variant())
        assert node.checks.errors == [] and 'error' not in '\n'.join(node.log.lines)


def filled(checks, seconds, begin=0.0, speed=3.0, factor=1.0):
    """Add samples of a robot that drives straight, gravity times ``factor``, up to a time."""
    for k in range(round(100 * begin), round(100 * seconds)):
        stamp_ns = round(1e7 * k) + NS_PER_S
        checks.add(stamp_ns, ImuSample(stamp_ns, (0.001 * (k % 7), 0.0, 9.81 * factor),
                                       (0.0, 0.0, 0.001 * (k % 5))))
        if k % 5 == 0:
            checks.add(stamp_ns, WheelSample(
                stamp_ns, (speed,) * 4, (speed * stamp_ns / NS_PER_S,) * 4))
    return round(seconds * NS_PER_S) + NS_PER_S


def polled(checks, now_ns):
    return checks.poll(now_ns, NO_LOAD, Counter())


def test_checks_take_their_share_of_a_core_and_rest_with_the_robot():
    begun = []
    checks = LiveChecks(ROBOT, lambda work: (begun.append(work), work()), lambda *_: ((), 1.0))
    polled(checks, NS_PER_S)
    now_ns = filled(checks, PERIOD)
    polled(checks, now_ns - 1)
    assert begun == []
    for later, count in ((0.0, 1), (1.0 / MAX_SHARE - 0.1, 1), (1.0 / MAX_SHARE, 2),
                         (200.0, 2)):  # without motion since
        if later > 1.0:
            filled(checks, 20.0, 19.0, 0.0 if later == 200.0 else 3.0)
        polled(checks, now_ns + round(later * NS_PER_S))
        assert len(begun) == count, later


def test_an_error_holds_until_the_robot_has_driven_without_it():
    checks = LiveChecks(ROBOT, lambda work: work(), at_once)
    polled(checks, NS_PER_S)
    found = polled(checks, filled(checks, PERIOD, factor=1.0 / 9.81))
    assert [one for one in found if 'in g' in one.text]
    end = filled(checks, 2 * WINDOW, PERIOD, speed=0.0)
    assert polled(checks, end) == found
    found = polled(checks, filled(checks, 4 * WINDOW, 2 * WINDOW))
    assert not [one for one in found if 'in g' in one.text]


def test_one_check_is_made_at_a_time_and_the_clock_may_be_set_back():
    works = []
    checks = LiveChecks(ROBOT, works.append, at_once)
    polled(checks, 1000 * NS_PER_S)
    polled(checks, NS_PER_S)
    for seconds in (PERIOD, PERIOD + 1.0, 3.0 * PERIOD):
        polled(checks, filled(checks, seconds))
    assert len(works) == 1
    works[0]()
    polled(checks, filled(checks, 5.0 * PERIOD))
    assert len(works) == 2


@pytest.mark.parametrize(('received', 'stamped'), [(-20.0, -20.0), (0.0, 0.6), (0.0, -0.6)])
def test_samples_before_a_clock_was_set_are_forgotten(received, stamped):
    checks, sizes = LiveChecks(ROBOT, lambda work: work(), at_once), []
    checks._check = lambda now_ns, samples, *_: sizes.append(len(samples))
    polled(checks, NS_PER_S)
    end_ns = filled(checks, 2.0 * WINDOW)
    for k in range(5):
        checks.add(end_ns + round(1e9 * received) + k, ImuSample(
            end_ns + round(1e9 * stamped) + k, (0.0, 0.0, 9.81), (0.0,) * 3))
    polled(checks, end_ns)
    assert sizes == [5]


def test_the_thread_ends_with_its_check(tmp_path, monkeypatch):
    (tmp_path / 'smart_tire.py').write_text('raise SystemExit("a module of the user")')
    monkeypatch.chdir(tmp_path)
    checks, done = LiveChecks(ROBOT), Event()
    in_thread(done.set)
    assert done.wait(PATIENCE)
    polled(checks, NS_PER_S)
    polled(checks, filled(checks, PERIOD, factor=1.0 / 9.81))
    wait_for(lambda: checks.errors)


def test_the_process_has_a_copy_of_the_environment(monkeypatch):
    begun = []

    def refused(*args, env, **_):
        begun.append(env)
        raise OSError('no process')
    monkeypatch.setenv('OF_THIS_TEST', 'set')
    monkeypatch.setattr(subprocess, 'Popen', refused)
    with pytest.raises(OSError, match='no process'):
        in_process(ROBOT, [], NO_LOAD, Counter())
    # the child would read that of the process while another thread changes it: EFAULT
    assert begun == [dict(os.environ)] and begun[0] is not os.environ


@pytest.mark.parametrize('cut', [0, 1000])
def test_a_process_whose_node_has_ended_says_nothing(cut):
    job = pickle.dumps((ROBOT, [(k, WheelSample(k, (1.0,) * 4)) for k in range(100)]))
    done = subprocess.run([sys.executable, '-c', PROGRAM, *sys.path], input=job[:cut],
                          capture_output=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, b'', b'')


def test_an_error_of_a_check_does_not_end_those_of_later_samples(monkeypatch):
    made = []

    def failing(*_):
        made.append(1)
        raise ArithmeticError('a check')
    monkeypatch.setattr('smart_tire.checks.live.findings', failing)
    checks, now_ns = LiveChecks(ROBOT, lambda work: work(), at_once), 100 * NS_PER_S
    assert checks.poll(now_ns, NO_LOAD, Counter()) == ()  # the first one is due later
    for count in (1, 2):
        now_ns += round(PERIOD * NS_PER_S)
        checks.add(now_ns, WheelSample(now_ns, (1.0,) * 4))
        with pytest.raises(ArithmeticError):
            checks.poll(now_ns, NO_LOAD, Counter())
        assert len(made) == count
