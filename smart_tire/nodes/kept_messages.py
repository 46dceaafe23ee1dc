# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Messages that publishers keep for subscriptions that come later, of any durability."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy

from smart_tire.control.publishers import MessageInfo
from smart_tire.samples import NS_PER_S

CHECK_PERIOD = 0.25  # s, in which a new publisher is noticed
WINDOW_NS = 10 * NS_PER_S


def keeping_publishers(node: Node, topic: str) -> set[Hashable]:
    """Return the identifiers of the publishers that keep messages for late subscriptions."""
    return {bytes(info.endpoint_gid) for info in node.get_publishers_info_by_topic(topic)
            if info.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL}


class KeptMessages:
    """
    Adds, to a volatile subscription to the topic ``name``, what transient-local publishers keep.

    A transient-local subscription lets every volatile publisher log that it is incompatible. So
    there is one, made by ``subscribe`` with its callback, only after a transient-local publisher
    has appeared, until a message is received, for at most ``WINDOW_NS``. All messages come with
    their info; each is handed to ``handle`` once, and a kept one only if it was published
    after all others: the newest order counts.
    """

    def __init__(self, node: Node, name: str, handle: Callable[[Any, MessageInfo], None],
                 subscribe: Callable[[Callable[[Any, MessageInfo], None]], Any]) -> None:
        self._node, self._name, self._handle, self._subscribe = node, name, handle, subscribe
        self._publishers: set[Hashable] = set()  # that keep messages, at the latest check
        self._subscription: Any = None
        self._end_ns = 0      # of the subscription, steady clock
        self._newest_ns = -1  # time of publication of the newest message
        self._kept: Hashable = None  # identifies the latest one of the additional subscription

    def check(self, now_ns: int) -> None:
        """Begin or end the additional subscription; to be called every ``CHECK_PERIOD``."""
        publishers = keeping_publishers(self._node, self._name)
        if publishers - self._publishers:
            self._end_ns = now_ns + WINDOW_NS
            self._subscription = self._subscription or self._subscribe(self._on_kept)
        elif self._subscription is not None and now_ns >= self._end_ns:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None
        self._publishers = publishers

    def on_message(self, msg: Any, info: MessageInfo) -> None:
        """Handle a message of the volatile subscription."""
        if identifier(info) != self._kept:
            self._hand_over(msg, info)

    def _on_kept(self, msg: Any, info: MessageInfo) -> None:
        self._end_ns = 0
        if info.source_ns > self._newest_ns:
            self._kept = identifier(info)
            self._hand_over(msg, info)

    def _hand_over(self, msg: Any, info: MessageInfo) -> None:
        self._newest_ns = max(self._newest_ns, info.source_ns)
        self._handle(msg, info)


def identifier(info: MessageInfo) -> Hashable:
    """Return what identifies a message; repeated content is not a repeated message."""
    return info.source_ns, info.number
