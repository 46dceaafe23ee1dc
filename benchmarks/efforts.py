"""Motor torques of wheel samples: removed, or those of wrong torque constants."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
import math

from smart_tire.samples import Sample, WheelSample
from smart_tire.simulation.offline import Event


def has_efforts(samples: Iterable[Sample]) -> bool:
    """Return whether any torque was measured."""
    return any(isinstance(sample, WheelSample) and sample.effort is not None
               and any(map(math.isfinite, sample.effort)) for sample in samples)


def without_efforts(samples: Iterable[Sample]) -> list[Sample]:
    """Return ``samples`` without torques."""
    return [replace(sample, effort=None) if isinstance(sample, WheelSample) else sample
            for sample in samples]


def scaled_efforts(events: Iterable[Event], factor: float) -> list[Event]:
    """Return ``events`` with all torques multiplied by ``factor``."""
    return [(received_ns, topic, _scaled(sample, factor))
            for received_ns, topic, sample in events]


def _scaled(sample: Sample, factor: float) -> Sample:
    if not isinstance(sample, WheelSample) or sample.effort is None:
        return sample
    fl, fr, rl, rr = (factor * torque for torque in sample.effort)
    return replace(sample, effort=(fl, fr, rl, rr))
