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

"""Several velocity inputs: priorities, time-outs, and conflicting publishers."""

from __future__ import annotations

import pytest

from smart_tire.control.command_check import VelocityMux
from smart_tire.samples import NS_PER_S, VelocityCommand

SLOW = VelocityCommand(0, 0.1, 0.0)
FAST = VelocityCommand(0, 0.9, 0.0)


@pytest.fixture
def mux():
    return VelocityMux([('nav', 5, 1.0), ('joystick', 10, 0.5)])


def test_without_a_command_nothing_is_selected(mux):
    assert mux.selected(0) is None


def test_a_command_is_selected_until_its_own_time_out(mux):
    mux.set_command('nav', SLOW, 0)
    assert mux.selected(NS_PER_S) == ('nav', SLOW)
    assert mux.selected(NS_PER_S + 1) is None


@pytest.mark.parametrize('order', [('nav', 'joystick'), ('joystick', 'nav')])
def test_the_higher_priority_is_selected_until_it_times_out(mux, order):
    commands = {'nav': FAST, 'joystick': SLOW}
    for name in order:
        mux.set_command(name, commands[name], 0)
    assert mux.selected(NS_PER_S // 2) == ('joystick', SLOW)
    assert mux.selected(NS_PER_S // 2 + 1) == ('nav', FAST)


def test_a_blocked_input_stops_the_robot_despite_inputs_of_lower_priority(mux):
    mux.set_command('joystick', SLOW, 0)
    mux.set_command('nav', FAST, 0)
    mux.block('joystick')
    assert mux.selected(0) is None
    mux.unblock('joystick')
    assert mux.selected(0) == ('nav', FAST)


def test_a_blocked_input_has_no_effect_below_a_valid_one(mux):
    mux.set_command('joystick', SLOW, 0)
    mux.block('nav')
    assert mux.selected(0) == ('joystick', SLOW)
    assert mux.selected(NS_PER_S) is None


def test_blocking_discards_the_command_and_ends_with_the_next_one(mux):
    mux.set_command('nav', FAST, 0)
    mux.block('nav')
    mux.unblock('nav')
    assert mux.selected(0) is None
    mux.block('nav')
    mux.set_command('nav', SLOW, 1)
    assert mux.selected(1) == ('nav', SLOW)


def test_all_commands_can_be_discarded(mux):
    mux.set_command('joystick', SLOW, 0)
    mux.set_command('nav', FAST, 0)
    mux.discard()
    assert mux.selected(0) is None


@pytest.mark.parametrize('names', [('a', 'b'), ('b', 'a')])
def test_priority_depends_on_the_number_not_on_the_name(names):
    low, high = names
    mux = VelocityMux([(low, 1, 1.0), (high, 2, 1.0)])
    mux.set_command(high, FAST, 0)
    mux.set_command(low, SLOW, 0)
    assert mux.selected(0) == (high, FAST)
