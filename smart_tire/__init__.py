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
Slip, pose and tire-road friction of a skid-steer robot from PVDF films in its tires.

A drive is recorded or simulated, and estimated in one call; all data are numpy arrays:

>>> from smart_tire import estimate, simulate
>>> recording = simulate([(0.5, 9.0, 7.0)], duration=2.0)  # s, left and right rad/s
>>> estimates = estimate(recording)
>>> estimates.slip.ratio.shape == (len(estimates.slip.stamp_ns), 4)
True

The names below are stable (semantic versioning); ``smart_tire.api`` has the classes of arguments
and results in addition. Everything else may change. Units are SI, timestamps integers [ns].
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    from smart_tire.api import (
        BrushTire, BucklingFilm, estimate, estimate_friction, estimate_slip, FilmSensor,
        fit_crossing, FrictionEstimate, load_params, plot, read_bag, Recording, simulate,
        SlipEstimate, TreadFilm, write_bag)

__version__ = '0.1.0'
__all__ = [
    'BrushTire', 'BucklingFilm', 'estimate', 'estimate_friction', 'estimate_slip', 'FilmSensor',
    'fit_crossing', 'FrictionEstimate', 'load_params', 'plot', 'read_bag', 'Recording', 'simulate',
    'SlipEstimate', 'TreadFilm', 'write_bag']


def __getattr__(name: str) -> Any:
    """Import a public name at its first use (PEP 562): nodes and command need none of them."""
    if name not in __all__:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    value = getattr(import_module(f'{__name__}.api'), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
