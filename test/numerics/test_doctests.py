# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The examples in the docstrings of the numerical methods."""

from __future__ import annotations

import doctest
import importlib
import inspect
import pkgutil

import pytest

from smart_tire import numerics

MODULES = [f'smart_tire.numerics.{module.name}'
           for module in pkgutil.iter_modules(numerics.__path__)
           if module.name != 'uncompiled']  # stands in for Cython


@pytest.mark.parametrize('name', MODULES)
def test_every_public_function_has_an_example_that_holds(name):
    module = importlib.import_module(name)
    examples = {test.name.rpartition('.')[2] for test in doctest.DocTestFinder().find(module)
                if test.examples}
    public = {key for key, value in inspect.getmembers(module, inspect.isfunction)
              if value.__module__ == name and not key.startswith('_')}
    assert not public - examples
    result = doctest.testmod(module)
    assert result.attempted and not result.failed
