# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A simulated drive for the tests of this folder, and its bag."""

from __future__ import annotations

import pytest

from smart_tire import load_params, simulate, write_bag

SPEEDS = [(0.5, 12.0, 6.0)]  # s, rad/s, rad/s


@pytest.fixture(scope='session')
def params():
    """Return parameters with two instrumented wheels on concrete."""
    return load_params(values={'film.wheels': ['front_left', 'front_right'],
                               'ground.base': 'concrete'})


@pytest.fixture(scope='session')
def recording(params):
    """Return three seconds of a simulated turn."""
    return simulate(SPEEDS, 3.0, params=params, seed=3)


@pytest.fixture(scope='session')
def bag(recording, tmp_path_factory):
    """Return the bag of the recording."""
    path = tmp_path_factory.mktemp('api') / 'turn'
    write_bag(path, recording)
    return path
