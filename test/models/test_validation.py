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

"""Arguments of the models: valid ones are returned, invalid ones named with their value."""

from hypothesis import given, strategies as st
import numpy as np
import pytest
from smart_tire.errors import ParameterError
from smart_tire.models import validation


@given(st.lists(st.floats(1e-9, 1e9)))
def test_valid_numbers_are_returned_unchanged(values):
    for check in (validation.numbers, validation.finite, validation.positive,
                  validation.not_negative):
        np.testing.assert_array_equal(check('x', values), values)


def test_zero_and_infinity_are_accepted_where_allowed():
    assert validation.not_negative('x', 0.0) == 0.0
    assert validation.not_negative('x', np.inf, infinite=True) == np.inf
    assert validation.numbers('x', -np.inf) == -np.inf


@pytest.mark.parametrize('call, message', [
    (lambda: validation.numbers('x', [[1.0, 2.0], [3.0, np.nan]]), r'x\[1, 1\] is nan'),
    (lambda: validation.numbers('x', [[1.0], [2.0, 3.0]]), 'x is not numeric'),
    (lambda: validation.numbers('x', None), 'x is nan'),
    (lambda: validation.finite('x', -np.inf), 'x is -inf, expected finite'),
    (lambda: validation.positive('x', [1.0, 0.0]), r'x\[1\] is 0.0, expected above zero'),
    (lambda: validation.not_negative('x', -1e-300), 'x is -1e-300, expected zero or more'),
    (lambda: validation.not_negative('x', np.inf), 'x is inf'),
    (lambda: validation.within('x', 2.0, 0.0, [3.0, 1.0], 'too far'), 'x.* is 2.0, too far'),
    (lambda: validation.fitting(a=np.ones(2), b=1.0, c=np.ones((4, 3))),
     r'do not broadcast: a \(2,\), c \(4, 3\)'),
    (lambda: validation.one_of('x', 'c', ('a', 'b')), "x is 'c', expected one of a, b")])
def test_invalid_arguments_are_named(call, message):
    with pytest.raises(ParameterError, match=message):
        call()
