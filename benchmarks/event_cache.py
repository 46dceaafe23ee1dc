"""
Cache of simulated events, for repeated benchmarks while an estimator is changed.

It is used if the environment variable ``FOLDER_VARIABLE`` names a folder. An entry is valid for
the same run and the same source of the simulator and its models; outdated ones remain until the
folder is deleted.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
import gc
import hashlib
import os
from pathlib import Path
import pickle

from smart_tire.simulation import offline

FOLDER_VARIABLE = 'SMART_TIRE_EVENT_CACHE'
SIMULATION_SOURCES = ('simulation', 'models', 'protocol', 'samples.py', 'rotation.py',
                      'uncertain.py')  # what determines events, besides the parameters


@cache
def source_digest() -> str:
    """Return a digest of the source of the simulator."""
    root, digest = Path(offline.__file__).parents[1], hashlib.sha256()
    for name in SIMULATION_SOURCES:
        path = root / name
        for file in sorted(path.rglob('*.py')) if path.is_dir() else [path]:
            digest.update(file.read_bytes())
    return digest.hexdigest()


def cached_events(run: str, make: Callable[[], list[offline.Event]]) -> list[offline.Event]:
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


def _load(path: Path) -> list[offline.Event]:
    # without garbage collection, which would search the growing list of samples again and again
    enabled = gc.isenabled()
    gc.disable()
    try:
        events: list[offline.Event] = pickle.loads(path.read_bytes())
    finally:
        if enabled:
            gc.enable()
    return events
