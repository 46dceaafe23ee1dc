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
Received messages of simulated runs: cached, taken apart, and without motor torques.

Events are cached, for repeated benchmarks while an estimator is changed, if the environment
variable ``FOLDER_VARIABLE`` names a folder. An entry is valid for the same run and the same source
of the simulator and its models; outdated ones remain until the folder is deleted.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
import gc
import hashlib
import math
import os
from pathlib import Path
import pickle

from smart_tire.samples import Sample, WheelSample
from smart_tire.simulation import offline
from smart_tire.simulation.offline import Event

FOLDER_VARIABLE = 'SMART_TIRE_EVENT_CACHE'
ROOT = Path(offline.__file__).parents[2]  # of the modules
IGNORED = 'smart_tire.parameters'         # their values describe the run


def truth_of(events: Iterable[Event]) -> list[Sample]:
    """Return the ground truth."""
    return [sample for _, topic, sample in events if topic.startswith('ground_truth/')]


def inputs_of(events: Iterable[Event]) -> list[Sample]:
    """Return the samples that the estimators take, in order of reception."""
    return [sample for _, topic, sample in events if not topic.startswith('ground_truth/')]


def has_efforts(samples: Iterable[Sample]) -> bool:
    """Return whether any torque was measured."""
    return any(isinstance(sample, WheelSample) and sample.effort is not None
               and any(map(math.isfinite, sample.effort)) for sample in samples)


def without_efforts(samples: Iterable[Sample]) -> list[Sample]:
    """Return ``samples`` without torques."""
    return [replace(sample, effort=None) if isinstance(sample, WheelSample) else sample
            for sample in samples]


def cached_events(run: str, make: Callable[[], list[Event]]) -> list[Event]:
    """
    Return ``make()``, or what it has returned for the same ``run``.

    ``run`` is a text that describes all parameters of the run.
    """
    folder = os.environ.get(FOLDER_VARIABLE)
    if not folder:
        return make()
    key = hashlib.sha256(f'{source_digest()} {run}'.encode()).hexdigest()[:24]
    path = Path(folder, f'{key}.pickle')
    if path.exists():
        return _load(path)
    events = make()
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(f'.{os.getpid()}')  # renamed when complete
    partial.write_bytes(pickle.dumps(events, pickle.HIGHEST_PROTOCOL))
    partial.replace(path)
    return events


@cache
def source_digest() -> str:
    """Return a digest of the modules that the offline simulator imports."""
    modules = imported_modules(offline.__name__)
    digest = hashlib.sha256()
    for name in sorted(modules):
        digest.update(modules[name].read_bytes())
    return digest.hexdigest()


def imported_modules(name: str) -> dict[str, Path]:
    """Return the own modules that the module ``name`` imports, directly or not, and itself."""
    found: dict[str, Path] = {}
    waiting = [name]
    while waiting:
        name = waiting.pop()
        path = ROOT.joinpath(*name.split('.')).with_suffix('.py')
        if name in found or name.startswith(IGNORED) or not path.exists():
            continue
        found[name] = path
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.ImportFrom) and node.module is not None:
                waiting += node.module, *(f'{node.module}.{alias.name}' for alias in node.names)
    return found


def _load(path: Path) -> list[Event]:
    # without garbage collection, which would search the growing list of samples again and again
    enabled = gc.isenabled()
    gc.disable()
    try:
        events: list[Event] = pickle.loads(path.read_bytes())
    finally:
        if enabled:
            gc.enable()
    return events
