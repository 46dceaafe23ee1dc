# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Arrays in nested records."""

from __future__ import annotations

import dataclasses

import numpy as np


def arrays(record: object, path: str = '') -> dict[str, np.ndarray]:
    """Return all arrays in nested dataclasses and mappings, by path."""
    if dataclasses.is_dataclass(record):
        items = {item.name: getattr(record, item.name) for item in dataclasses.fields(record)}
    elif isinstance(record, dict):
        items = record
    else:
        return {path: np.asarray(record)}
    return {key: value for name, item in items.items()
            for key, value in arrays(item, f'{path}.{name}').items()}


def assert_same_arrays(found: object, expected: object, tolerance: float) -> None:
    """Check that two records have the same arrays, numbers to a relative ``tolerance``."""
    own, other = arrays(found), arrays(expected)
    assert own.keys() == other.keys()
    for name, values in other.items():
        if values.dtype.kind == 'f':
            np.testing.assert_allclose(own[name], values, rtol=tolerance, atol=tolerance,
                                       err_msg=name)
        else:
            np.testing.assert_array_equal(own[name], values, err_msg=name)
