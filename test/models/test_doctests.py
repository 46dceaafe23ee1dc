# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Docstrings of the models: every public function has a doctest, and all of them pass."""

from __future__ import annotations

from collections.abc import Iterator
import doctest
import importlib
import inspect
import pkgutil
from types import ModuleType

import pytest

from smart_tire import models

MODULES = sorted(module.name for module in pkgutil.walk_packages(
    models.__path__, f'{models.__name__}.') if not module.ispkg)


def public_functions(module: ModuleType) -> Iterator[str]:
    """Yield the names of the public functions that ``module`` defines."""
    for name, function in inspect.getmembers(module, inspect.isfunction):
        if not name.startswith('_') and function.__module__ == module.__name__:
            yield name


def public_classes(module: ModuleType) -> Iterator[str]:
    """Yield the names of the public classes with public methods that ``module`` defines."""
    for name, kind in inspect.getmembers(module, inspect.isclass):
        methods = [key for key, value in vars(kind).items()
                   if inspect.isfunction(value) and not key.startswith('_')]
        if not name.startswith('_') and kind.__module__ == module.__name__ and methods \
                and not issubclass(kind, tuple):
            yield name


def examples(module: ModuleType) -> dict[str, doctest.DocTest]:
    """Return the doctests of ``module`` that show an output, by the name of their object."""
    prefix = f'{module.__name__}.'
    return {test.name.removeprefix(prefix): test
            for test in doctest.DocTestFinder().find(module, module.__name__)
            if any(example.want for example in test.examples)}


@pytest.mark.parametrize('name', MODULES)
def test_every_public_function_has_a_doctest(name):
    module = importlib.import_module(name)
    required = [*public_functions(module), *public_classes(module)]
    found = examples(module)
    assert [item for item in required if item not in found and not any(
        key.startswith(f'{item}.') for key in found)] == []


@pytest.mark.parametrize('name', MODULES)
def test_all_doctests_pass(name, capsys):
    runner = doctest.DocTestRunner()
    for test in examples(importlib.import_module(name)).values():
        runner.run(test)
    assert runner.summarize().failed == 0, capsys.readouterr().out
