# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Normalized errors of the identified values, and how often each was identified."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.calibration.recordings import ROUTES, write_bags
import numpy as np
from smart_tire.analysis.calibrate import calibrate_bags
from smart_tire.analysis.pipeline import EstimatorParams


@dataclass(frozen=True)
class Run:
    """Errors of one calibration, and the parameters that were kept."""

    route: str
    seed: int
    errors: dict[str, tuple[float, ...]]     # parameter -> errors over standard errors
    relative: dict[str, tuple[float, ...]]   # parameter -> standard errors over true values
    kept: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Score:
    """Consistency of the values of one parameter, or of all."""

    runs: int        # with at least one value
    within: float    # share of values within two standard errors
    nees: float      # mean of the squared normalized errors
    mean: float      # of the normalized errors


def calibrated_run(route: str, seed: int, *, films: bool = True) -> Run:
    """Return the errors of a simulated calibration."""
    run = ROUTES[route](seed, films=films)
    with TemporaryDirectory() as folder:
        found = calibrate_bags(write_bags(Path(folder), run), EstimatorParams(), '').calibration
    errors, relative = {}, {}
    for one in found.found.values():
        if one.sigma is None or one.name not in run.truth:
            continue
        value, sigma = np.atleast_1d(one.value), np.atleast_1d(one.sigma)
        true = np.array(run.truth[one.name])
        errors[one.name] = tuple(((value - true) / sigma).tolist())
        relative[one.name] = tuple((sigma / np.maximum(np.abs(true), 1e-9)).tolist())
    return Run(route, seed, errors, relative,
               {name: why for name, why in found.kept.items() if name in run.truth})


def parameters(runs: Iterable[Run]) -> list[str]:
    """Return the names of all parameters, in order of their first appearance."""
    return list(dict.fromkeys(name for run in runs for name in (*run.errors, *run.kept)))


def score(runs: Sequence[Run], name: str | None = None) -> Score | None:
    """Return the score of a parameter, or of all pooled; None if it was never identified."""
    values = [value for run in runs for key, errors in run.errors.items()
              if name in (None, key) for value in errors]
    if not values:
        return None
    errors = np.array(values)
    count = sum(name in run.errors if name else bool(run.errors) for run in runs)
    return Score(count, float(np.mean(np.abs(errors) <= 2.0)), float(np.mean(errors ** 2)),
                 float(np.mean(errors)))
