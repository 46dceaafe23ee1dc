# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The guided sequence with scripted topics: order, progress, repeat, skip and quit."""

from __future__ import annotations

import pytest
from smart_tire.calibration.guide import (
    Action, Guide, INSTRUCTIONS, Key, LEGS, LiftedWatch, limited, reach, RestWatch,
    StraightWatch, TurnWatch, WATCHES)
from smart_tire.calibration.sequence import REST, STEPS, STRAIGHT, TURNS
from smart_tire.samples import ImuSample, NS_PER_S, WheelSample

PERIOD = 0.05  # s


class Robot:
    """Samples of a robot with scripted motion."""

    def __init__(self, target):
        self.target, self.steps = target, 0

    def move(self, seconds, wheels=0.0, yaw_rate=0.0):
        """Pass the samples of ``seconds``; return the actions that they cause."""
        actions = []
        for _ in range(round(seconds / PERIOD)):
            self.steps += 1
            stamp = round(self.steps * PERIOD * NS_PER_S)
            for sample in (ImuSample(stamp, (0.0, 0.0, 9.81), (0.0, 0.0, yaw_rate)),
                           WheelSample(stamp, (wheels,) * 4)):
                actions += self.target.take(sample) or []
        return actions


def test_rest_ends_by_itself_after_ten_seconds_and_motion_starts_it_again():
    guide = Guide([REST])
    robot = Robot(guide)
    assert robot.move(20.0) == []  # waiting for the user: nothing is recorded
    assert guide.key(Key.GO) == [Action.RECORD]
    assert robot.move(RestWatch.needed - 1.0) == [] and not guide.progress.warning
    assert robot.move(0.2, wheels=1.0) == [] and 'again' in guide.progress.warning
    assert robot.move(RestWatch.needed - 1.0) == [] and not guide.progress.warning
    assert robot.move(2.0) == [Action.KEEP]
    assert guide.step is None and guide.recorded == [REST]


def test_a_body_that_rocks_is_not_at_rest():
    watch = RestWatch()
    robot = Robot(watch)
    robot.move(5.0)
    robot.move(0.1, yaw_rate=0.2)
    assert watch.progress.text.startswith('at rest for 0 ')


def test_straight_counts_complete_starts_in_both_directions_but_not_turns():
    watch = StraightWatch()
    robot = Robot(watch)
    for _ in range(StraightWatch.needed):
        robot.move(1.0, wheels=8.0)
        assert not watch.progress.done
        robot.move(0.5)
    robot.move(1.0, wheels=-8.0, yaw_rate=0.5)
    assert 'turns' in watch.progress.warning
    robot.move(0.5)
    robot.move(1.0, wheels=-1.0)  # too slow for slip
    robot.move(0.5)
    assert watch.seen == {1: StraightWatch.needed, -1: 0}
    for _ in range(StraightWatch.needed):
        assert not watch.progress.done
        robot.move(1.0, wheels=-8.0)
        robot.move(0.5)
    assert watch.progress.done and watch.seen == {1: 6, -1: 6}


def test_turns_need_a_full_circle_in_each_direction_with_rotating_wheels():
    watch = TurnWatch()
    robot = Robot(watch)
    robot.move(20.0, wheels=0.0, yaw_rate=1.0)  # carried by hand
    robot.move(20.0, wheels=5.0, yaw_rate=0.05)
    assert watch.seen == {1: 0.0, -1: 0.0}
    robot.move(6.5, wheels=5.0, yaw_rate=1.0)
    assert not watch.progress.done and watch.seen[1] == pytest.approx(372.0, abs=6.0)
    robot.move(6.5, wheels=5.0, yaw_rate=-1.0)
    assert watch.progress.done


def test_lifted_wheels_rotate_while_the_body_rests():
    watch = LiftedWatch()
    robot = Robot(watch)
    robot.move(20.0, wheels=5.0, yaw_rate=0.5)
    assert 'off the ground' in watch.progress.warning
    robot.move(9.0, wheels=5.0)
    assert not watch.progress.done and not watch.progress.warning
    robot.move(9.0, wheels=-5.0)
    assert watch.progress.done


def test_steps_can_be_ended_early_repeated_and_skipped():
    guide = Guide([REST, STRAIGHT, TURNS])
    assert guide.number == '1/3' and guide.key(Key.GO) == [Action.RECORD]
    assert guide.key(Key.REPEAT) == [Action.DISCARD, Action.RECORD] and guide.step == REST
    assert guide.key(Key.GO) == [Action.KEEP] and guide.step == STRAIGHT
    assert guide.key(Key.SKIP) == [] and guide.step == TURNS and guide.number == '3/3'
    assert guide.key(Key.GO) == [Action.RECORD]
    assert guide.key(Key.SKIP) == [Action.DISCARD] and guide.step is None
    assert guide.recorded == [REST] and guide.key(Key.GO) == []


def test_quitting_discards_the_present_step_and_keeps_the_former_ones():
    guide = Guide([REST, STRAIGHT, TURNS])
    for key in (Key.GO, Key.GO, Key.GO):
        guide.key(key)
    assert guide.step == STRAIGHT and guide.progress is not None
    assert guide.key(Key.QUIT) == [Action.DISCARD]
    assert guide.step is None and guide.recorded == [REST] and guide.finish() == []


def test_every_step_has_an_instruction():
    assert set(INSTRUCTIONS) == set(STEPS)


def test_driven_legs_return_to_rest_and_keep_below_the_speed_limit():
    for legs in LEGS.values():
        assert legs[-1][1:] == (0.0, 0.0)
    assert LEGS[REST][0][0] > RestWatch.needed
    small, large = (max(abs(leg[1]) for leg in limited(LEGS[STRAIGHT], radius))
                    for radius in (0.087, 0.3))
    assert small == 140.0
    assert large * 0.3 * 2.0 * 3.14159 / 60.0 == pytest.approx(1.3, abs=1e-3)


def test_the_announced_space_contains_the_path():
    assert reach(((2.0, 60.0, 60.0),), 0.1, 0.4) == pytest.approx(1.757, abs=0.01)
    assert reach(LEGS[REST], 0.1, 0.4) == 0.5
    wide = reach(LEGS[TURNS], 0.087, 0.38)
    assert 2.0 < wide < 6.0


@pytest.mark.parametrize('step', [STRAIGHT, TURNS])
def test_driven_steps_satisfy_their_watches(step):
    watch = WATCHES[step]()
    robot = Robot(watch)
    for duration, left, right in LEGS[step]:
        wheels = 0.5 * (left + right) * 0.105 or abs(left) * 0.05
        robot.move(duration, wheels, (right - left) * 0.105 * 0.087 / 0.57)
    assert watch.progress.done
