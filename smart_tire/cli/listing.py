"""Lists that several verbs print."""

from __future__ import annotations

from collections.abc import Iterable, Mapping


def print_counts(counts: Mapping[str, int]) -> None:
    """Print the number of messages by topic."""
    width = max((len(str(count)) for count in counts.values()), default=1)
    for topic, count in sorted(counts.items()):
        print(f'  {count:{width}} {topic}')


def print_losses(losses: Iterable[str]) -> None:
    """Print what could not be read."""
    for loss in losses:
        print(f'lost: {loss}')
