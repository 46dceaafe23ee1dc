# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Kept messages: when there is a second subscription, and which messages are handled."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from rclpy.qos import QoSProfile

from smart_tire.control.publishers import MessageInfo
from smart_tire.nodes.kept_messages import KeptMessages
from smart_tire.nodes.qos import latched

pytestmark = pytest.mark.processes

START_NS, WINDOW_NS = 5_000_000_000, 10_000_000_000


class Rig:
    """A node whose graph is ``publishers``: identifier -> profile."""

    def __init__(self) -> None:
        self.publishers: dict[bytes, QoSProfile] = {}
        self.handled: list[str] = []
        self.on_kept: Callable[[Any, Any], None] | None = None  # callback while subscribed
        self.kept = KeptMessages(self, 'path', lambda msg, info: self.handled.append(msg),
                                 self._subscribe)
        self.on_message = self.kept.on_message

    def _subscribe(self, callback: Callable[[Any, Any], None]) -> str:
        assert self.on_kept is None
        self.on_kept = callback
        return 'subscription'

    def destroy_subscription(self, subscription: str) -> None:
        """End the additional subscription."""
        assert subscription == 'subscription'
        self.on_kept = None

    def get_publishers_info_by_topic(self, name: str) -> list[Any]:
        """Return the publishers of the topic."""
        assert name == 'path'
        return [SimpleNamespace(endpoint_gid=gid, qos_profile=profile)
                for gid, profile in self.publishers.items()]


@pytest.fixture
def rig() -> Rig:
    """Return a node that has discovered no publisher."""
    return Rig()


def info(published_ns: int, number: int | None = 1) -> MessageInfo:
    """Return the info of a message."""
    return MessageInfo(published_ns, published_ns, number)


def test_volatile_publishers_never_meet_a_transient_local_subscription(rig):
    for now_ns in range(START_NS, START_NS + 3 * WINDOW_NS, WINDOW_NS // 40):
        rig.publishers[b'%d' % now_ns] = QoSProfile(depth=1)
        rig.kept.check(now_ns)
        assert rig.on_kept is None


def test_a_new_transient_local_publisher_is_awaited_until_its_message_or_the_window_ends(rig):
    rig.publishers[b'1'] = latched()
    rig.kept.check(START_NS)
    rig.kept.check(START_NS + WINDOW_NS - 1)
    assert rig.on_kept is not None
    rig.kept.check(START_NS + WINDOW_NS)
    assert rig.on_kept is None
    rig.publishers[b'2'] = latched()
    rig.kept.check(START_NS + WINDOW_NS + 1)
    rig.on_kept('path', info(1))
    assert rig.handled == ['path']
    assert rig.on_kept is not None  # others may follow at once
    rig.kept.check(START_NS + WINDOW_NS + 2)
    assert rig.on_kept is None
    rig.kept.check(START_NS + 5 * WINDOW_NS)
    assert rig.on_kept is None


def test_a_publisher_that_appears_meanwhile_has_a_window_of_its_own(rig):
    rig.publishers[b'1'] = latched()
    rig.kept.check(START_NS)
    rig.on_kept('a', info(1))
    rig.publishers[b'2'] = latched()
    rig.kept.check(START_NS + 1)
    rig.kept.check(START_NS + WINDOW_NS)
    assert rig.on_kept is not None
    rig.kept.check(START_NS + WINDOW_NS + 1)
    assert rig.on_kept is None


def test_a_publisher_that_returns_is_new(rig):
    for begin_ns in (START_NS, START_NS + 3 * WINDOW_NS):
        rig.publishers = {b'1': latched()}
        rig.kept.check(begin_ns)
        assert rig.on_kept is not None
        rig.publishers = {}
        rig.kept.check(begin_ns + WINDOW_NS)
        assert rig.on_kept is None


@pytest.mark.parametrize('kept_first', [True, False])
def test_a_message_that_both_subscriptions_receive_is_handled_once(rig, kept_first):
    rig.publishers[b'1'] = latched()
    rig.kept.check(START_NS)
    callbacks = (rig.on_kept, rig.on_message)
    for number in (1, 2):
        for callback in callbacks if kept_first else reversed(callbacks):
            callback(f'path {number}', info(100 + number, number))
    assert rig.handled == ['path 1', 'path 2']


def test_repeated_content_and_a_second_publisher_at_the_same_time_are_handled(rig):
    for published_ns, number in ((7, 1), (8, 2), (8, 3), (6, 1)):  # the last: of another clock
        rig.on_message('path', info(published_ns, number))
    assert rig.handled == ['path'] * 4


def test_what_was_kept_from_before_the_newest_message_is_outdated(rig):
    """A new publisher makes DDS repeat what all others keep, however long ago it was followed."""
    rig.publishers = {b'1': latched(), b'2': QoSProfile(depth=1)}
    rig.kept.check(START_NS)
    rig.on_kept('first', info(100))
    rig.kept.check(START_NS + 1)
    for number in range(50):
        rig.on_message('renewed', info(200 + number, number))
    del rig.handled[:]
    rig.publishers[b'3'] = latched()
    rig.kept.check(START_NS + 2)
    rig.on_kept('first', info(100))
    rig.on_kept('renewed', info(249, 49))
    assert not rig.handled
    rig.on_kept('newest', info(250))
    assert rig.handled == ['newest']


def test_middleware_without_sequence_numbers_is_served(rig):
    rig.publishers[b'1'] = latched()
    rig.kept.check(START_NS)
    for callback in (rig.on_kept, rig.on_message):
        callback('path', info(0, number=None))
    assert rig.handled == ['path']
