"""The examples in the docstrings of the numerical methods."""

from __future__ import annotations

import doctest
import importlib
import inspect
import pkgutil

import pytest

from smart_tire import numerics

MODULES = [f'smart_tire.numerics.{module.name}'
           for module in pkgutil.iter_modules(numerics.__path__)]


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
