"""What several verbs ask of their arguments."""

from __future__ import annotations


def positive(text: str) -> float:
    """Return the number in ``text``; raise ValueError unless it is above zero and finite."""
    number = float(text)
    if not 0.0 < number < float('inf'):
        raise ValueError(text)
    return number
