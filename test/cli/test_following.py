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

"""When a path has ended: reports of the controller, its silence, time limits."""

from __future__ import annotations

import pytest

from smart_tire.cli._drive_session import (
    ANSWER_TIME, EXTRA_TIME, Following, MIN_MEAN_SPEED, note, OLD_REPORT_TIME, SILENCE_TIME)
from smart_tire.cli._stack import RobotError
from smart_tire.control.trajectory_control import State
from smart_tire.samples import NAN, PathProgress

BEGIN = 100.0  # s


def report(state):
    return PathProgress(0, NAN, NAN, int(state))


def run(*reports, length=1.0):
    """Return the result of the last of ``reports`` (seconds after the begin, state or None)."""
    following, result = Following(length, BEGIN), None
    for seconds, state in reports:
        result = following.update(None if state is None else report(state), BEGIN + seconds)
    return result


@pytest.mark.parametrize('end', [State.ARRIVED, State.STOPPED, State.REFUSED, State.IDLE])
def test_the_state_after_following_is_the_result(end):
    assert run((0.1, State.FOLLOWING), (0.2, State.FOLLOWING)) is None
    assert run((0.1, State.FOLLOWING), (0.2, end)) == end


@pytest.mark.parametrize('old', [State.ARRIVED, State.STOPPED, State.REFUSED])
def test_a_report_about_the_path_before_is_no_result(old):
    assert run((OLD_REPORT_TIME - 0.1, old)) is None
    assert run((OLD_REPORT_TIME - 0.1, old), (OLD_REPORT_TIME, State.FOLLOWING)) is None
    assert run((OLD_REPORT_TIME + 0.1, old)) == old


def test_on_a_busy_host_all_times_are_longer():
    following = Following(1.0, BEGIN, patience=10.0)
    arrived = report(State.ARRIVED)
    assert following.update(arrived, BEGIN + 10.0 * OLD_REPORT_TIME - 0.1) is None
    assert following.update(arrived, BEGIN + 10.0 * OLD_REPORT_TIME + 0.1) == State.ARRIVED
    idle = report(State.IDLE)
    assert Following(1.0, BEGIN, patience=10.0).update(idle, BEGIN + 10.0 * ANSWER_TIME) is None
    assert following.update(report(State.FOLLOWING), BEGIN + 15.0) is None
    assert following.update(None, BEGIN + 15.0 + 10.0 * SILENCE_TIME) is None
    with pytest.raises(RobotError, match='does not report'):
        following.update(None, BEGIN + 15.1 + 10.0 * SILENCE_TIME)


def test_the_latest_distance_that_was_reported_is_kept():
    following = Following(2.0, BEGIN)
    assert following.remaining == 2.0
    for distance, state in ((1.5, State.FOLLOWING), (NAN, State.FOLLOWING), (NAN, State.STOPPED)):
        following.update(PathProgress(0, distance, NAN, int(state)), BEGIN + 1.0)
    assert following.remaining == 1.5


def test_a_controller_that_stays_idle_has_not_received_the_path():
    assert run((ANSWER_TIME - 0.1, State.IDLE)) is None
    with pytest.raises(RobotError, match='has not received the path'):
        run((1.0, State.IDLE), (2.0, State.IDLE), (ANSWER_TIME + 0.1, State.IDLE))


def test_silence_is_an_error():
    for first in ((), ((0.2, State.FOLLOWING),)):
        since = first[0][0] if first else 0.0
        following = Following(1.0, BEGIN)
        latest = report(State.FOLLOWING) if first else None
        following.update(latest, BEGIN + since)
        assert following.update(latest, BEGIN + since + SILENCE_TIME - 0.01) is None
        with pytest.raises(RobotError, match='does not report'):
            following.update(latest, BEGIN + since + SILENCE_TIME + 0.01)


def test_the_time_is_limited_by_a_mean_speed():
    limit = EXTRA_TIME + 2.0 / MIN_MEAN_SPEED
    steps = [(float(k), State.FOLLOWING) for k in range(int(limit))]
    assert run(*steps, (limit, State.FOLLOWING), length=2.0) is None
    with pytest.raises(RobotError, match='not reached within 70 s'):
        run(*steps, (limit + 0.1, State.FOLLOWING), length=2.0)


def test_times_are_those_that_a_user_waits():
    assert (ANSWER_TIME, SILENCE_TIME, EXTRA_TIME, MIN_MEAN_SPEED) == (3.0, 3.0, 30.0, 0.05)


def test_the_note_omits_unknown_distances():
    assert note(None) == 'waiting for trajectory_controller'
    assert note(report(State.IDLE)) == 'idle'
    assert note(PathProgress(0, 1.234, -0.02, 1)) == (
        'following, 1.23 m left, -0.020 m from the path')
