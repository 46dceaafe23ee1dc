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
Messages handed from node to node within one process, without DDS.

They are handed over serialized, as they are published: the same bytes go through the same checks
and conversions as those from another process, and no object is shared between threads.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from rclpy.node import Node


@dataclass(eq=False)
class Inbox:
    """The latest messages of one topic that wait for one node."""

    route: Route
    on_message: Callable[[bytes], None]
    waiting: deque[bytes]            # of limited length, as the queue of a subscription
    wake: Callable[[], None] | None  # None: handled with the next message of another input
    lost: int = 0                    # messages that newer ones displaced

    def put(self, data: bytes) -> None:
        """Add a message, from the thread of its publisher."""
        if len(self.waiting) == self.waiting.maxlen:
            self.lost += 1
        self.waiting.append(data)
        if self.wake is not None:
            self.wake()


@dataclass(eq=False)
class Route:
    """A topic that nodes of this process publish, and the inboxes of its subscribers here."""

    publishers: set[str] = field(default_factory=set)  # fully qualified names of the nodes
    inboxes: tuple[Inbox, ...] = ()  # replaced as a whole, since publishers iterate over it

    def hand_over(self, data: bytes) -> None:
        """Give a message to all subscribers in this process."""
        for inbox in self.inboxes:
            inbox.put(data)


class Exchange:
    """The topics that are handed over within this process; ``live`` if drivers publish them."""

    def __init__(self, *, live: bool) -> None:
        self.live = live
        self._routes: dict[str, Route] = {}

    def publish(self, topic: str, node: str) -> Route:
        """Return the route of a resolved topic, which ``node`` publishes from now on."""
        route = self._routes.setdefault(topic, Route())
        route.publishers.add(node)
        return route

    def published(self, topic: str) -> Route | None:
        """Return the route of a resolved topic that is published here, otherwise None."""
        return self._routes.get(topic)


class Mailbox:
    """
    The inboxes of a node; the thread that spins the node calls ``handle`` after each event.

    Messages that arrive end its wait by an empty task. A task that handled them could not raise:
    the events executor of rclpy ends the process without a traceback.
    """

    def __init__(self, node: Node) -> None:
        self.inboxes: dict[str, Inbox] = {}  # by name of the input
        self._node = node
        self._is_woken = False

    def add(self, name: str, route: Route, on_message: Callable[[bytes], None],
            depth: int, *, urgent: bool = True) -> Inbox:
        """
        Return a new inbox for at most ``depth`` messages of ``route``.

        Those that are not ``urgent`` wait for the next event of the node, and are handled first.
        """
        inbox = Inbox(route, on_message, deque(maxlen=depth), self._wake if urgent else None)
        self.inboxes[name] = inbox
        route.inboxes = (*route.inboxes, inbox)
        return inbox

    def remove(self, name: str) -> None:
        """End the input ``name``; its messages that wait are discarded."""
        inbox = self.inboxes.pop(name)
        inbox.route.inboxes = tuple(other for other in inbox.route.inboxes if other is not inbox)

    def handle(self) -> None:
        """Handle the messages that wait."""
        self._is_woken = False  # first: a message that arrives from here on wakes again
        for inbox in sorted(self.inboxes.values(), key=lambda inbox: inbox.wake is not None):
            for _ in range(len(inbox.waiting)):
                inbox.on_message(inbox.waiting.popleft())

    def _wake(self) -> None:
        executor: Any = self._node.executor
        if not self._is_woken and executor is not None:
            self._is_woken = True
            executor.create_task(return_nothing)


def return_nothing() -> None:
    """Do nothing: a task that ends the wait of an executor."""
