# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Recordings of real robots, which are not part of the repository."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

VARIABLE = 'SMART_TIRE_RECORDINGS'  # of the environment: their folder
DEFAULT = Path(__file__).resolve().parents[3] / 'shared' / 'data'


def real_recording(name: str) -> Path:
    """Return the path of a recording; skip the test if it is missing."""
    path = Path(os.environ.get(VARIABLE, DEFAULT)) / name
    if not path.exists():
        pytest.skip(f'needs the recordings of real robots (set {VARIABLE}): no {path}')
    return path
