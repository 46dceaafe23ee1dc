"""What the estimator nodes share: every input sample through the core, every result out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol, TypeVar

from smart_tire.messages import topic_of
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.diagnostics import Status
from smart_tire.nodes.lockstep import Follower
from smart_tire.samples import Sample

Params = TypeVar('Params')


class Core(Protocol):
    """An estimator that knows nothing of ROS."""

    def update(self, sample: Any) -> list[Any]:
        """Take a sample; return the estimates that are complete with it."""

    @property
    def late(self) -> Mapping[str, int]:
        """Return topic -> samples that came too late and were dropped."""

    def status(self) -> Mapping[str, str | int | float]:
        """Return what diagnostics should tell."""


class EstimatorNode(SmartTireNode[Params]):
    """
    A node around an estimator; it has no clock of its own, only the stamps of its inputs.

    During a replay it takes them in the order in which they were recorded.
    """

    feedback: tuple[str, ...] = ()  # inputs that rest on this node's own outputs

    def __init__(self, name: str, params_class: type[Params], core: Callable[[Params], Core],
                 outputs: tuple[str, ...]) -> None:
        super().__init__(name, params_class)
        self._new_core = core
        self._publish = {output: self.advertise(output) for output in outputs}
        self._topics = {output: self.resolve_topic_name(output) for output in outputs}
        self._follower = Follower(self, self.restart)
        for topic in self._topics.values():
            self._follower.add_output(topic)
        self._foreign_reported = 0
        self.restart()

    def restart(self) -> None:
        """Begin with a new estimator, to which nothing has happened."""
        self.core = self._new_core(self.params)
        self._late_reported = 0

    def intake(self, name: str, handle: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return what the subscription to ``name`` calls: during a replay, it waits its turn."""
        return self._follower.add_input(
            self.resolve_topic_name(name), handle, feedback=name in self.feedback)

    def feed(self, sample: Sample) -> None:
        """Take a sample of any input and publish what it completes."""
        for estimate in self.core.update(sample):
            self.put_out(estimate)

    def put_out(self, estimate: Sample) -> None:
        """Publish one estimate."""
        name = topic_of(estimate)
        self._publish[name](estimate)
        self._follower.published(self._topics[name], estimate.stamp_ns)

    def fill_status(self, status: Status) -> None:
        """Add what came too late, and the estimator's own state."""
        late = self.core.late
        status.values['late_messages'] = total = sum(late.values())
        status.values.update({f'{name}.late_messages': count for name, count in late.items()})
        status.values.update(self.core.status())
        if total > self._late_reported:
            status.warn(f'{total - self._late_reported} messages came too late')
        self._late_reported = total
        self._check_replay(status)

    def _check_replay(self, status: Status) -> None:
        if gone := self._follower.abandon():
            self.get_logger().warning(f'{gone} has vanished during a replay: inputs are taken '
                                      'as they come again')
        if self._follower.leader:
            status.values['replay'] = self._follower.leader
        if new := self._follower.foreign - self._foreign_reported:
            status.warn(f'{new} messages came during a replay that are not of it')
        self._foreign_reported = self._follower.foreign
