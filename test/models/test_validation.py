# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Arguments of the models: valid ones are returned, invalid ones named with their value."""

from hypothesis import given, strategies as st
import numpy as np
import pytest
from smart_tire.errors import ParameterError
from smart_tire.models import validation


@given(st.lists(st.floats(1e-9, 1e9)))
def test_valid_numbers_are_returned_unchanged(values):
    for check in (validation.finite, validation.positive):
        np.testing.assert_array_equal(check('x', values), values)


@pytest.mark.parametrize('call, message', [
    (lambda: validation.finite('x', [[1.0, 2.0], [3.0, np.nan]]), r'x\[1, 1\] is nan'),
    (lambda: validation.finite('x', [[1.0], [2.0, 3.0]]), 'x is not numeric'),
    (lambda: validation.finite('x', -np.inf), 'x is -inf, expected finite'),
    (lambda: validation.positive('x', [1.0, 0.0]), r'x\[1\] is 0.0, expected above zero'),
    (lambda: validation.one_of('x', 'c', ('a', 'b')), "x is 'c', expected one of a, b")])
def test_invalid_arguments_are_named(call, message):
    with pytest.raises(ParameterError, match=message):
        call()
