"""What the estimator nodes share: every input sample through the core, every result out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol, TypeVar

from smart_tire.messages import topic_of
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.diagnostics import Status
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
    """A node around an estimator; it has no clock of its own, only the stamps of its inputs."""

    def __init__(self, name: str, params_class: type[Params], core: Callable[[Params], Core],
                 outputs: tuple[str, ...]) -> None:
        super().__init__(name, params_class)
        self.core = core(self.params)
        self._publish = {output: self.advertise(output) for output in outputs}
        self._late_reported = 0

    def feed(self, sample: Sample) -> None:
        """Take a sample of any input and publish what it completes."""
        for estimate in self.core.update(sample):
            self.put_out(estimate)

    def put_out(self, estimate: Sample) -> None:
        """Publish one estimate."""
        self._publish[topic_of(estimate)](estimate)

    def fill_status(self, status: Status) -> None:
        """Add what came too late, and the estimator's own state."""
        late = self.core.late
        status.values['late_messages'] = total = sum(late.values())
        status.values.update({f'{name}.late_messages': count for name, count in late.items()})
        status.values.update(self.core.status())
        if total > self._late_reported:
            status.warn(f'{total - self._late_reported} messages came too late')
        self._late_reported = total
