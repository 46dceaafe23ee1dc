# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Docstrings of models and numerical methods: public functions have doctests that hold."""

from __future__ import annotations

from collections.abc import Iterator
import doctest
import importlib
import inspect
import pkgutil
from types import ModuleType

import pytest

from smart_tire import models, numerics

MODULES = sorted(
    module.name for package in (models, numerics)
    for module in pkgutil.walk_packages(package.__path__, f'{package.__name__}.')
    if not module.ispkg and module.name != 'smart_tire.numerics.uncompiled')  # in place of Cython


def public_names(module: ModuleType) -> Iterator[str]:
    """Yield names of functions, and of classes of models that have methods, of ``module``."""
    for name, item in vars(module).items():
        if name.startswith('_') or getattr(item, '__module__', None) != module.__name__:
            continue
        if inspect.isfunction(item) or (
                inspect.isclass(item) and not issubclass(item, tuple)
                and module.__name__.startswith(models.__name__)
                and any(inspect.isfunction(value) and not key.startswith('_')
                        for key, value in vars(item).items())):
            yield name


@pytest.mark.parametrize('name', MODULES)
def test_every_public_function_has_a_doctest_that_holds(name, capsys):
    module = importlib.import_module(name)
    found = {test.name.removeprefix(f'{name}.'): test for test in doctest.DocTestFinder().find(
        module, name) if any(example.want for example in test.examples)}
    tested = {part for key in found for part in (key, key.partition('.')[0])}
    assert [item for item in public_names(module) if item not in tested] == []
    runner = doctest.DocTestRunner()
    for test in found.values():
        runner.run(test)
    assert runner.summarize().failed == 0, capsys.readouterr().out
