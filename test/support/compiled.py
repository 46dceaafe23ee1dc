# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Modules that are compiled where there is a compiler, also as Python."""

from __future__ import annotations

from importlib.machinery import ModuleSpec
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
import sys
from types import ModuleType
from unittest.mock import patch

import smart_tire
from smart_tire.models.tire import brush_tire

PACKAGE = Path(smart_tire.__file__).parent
# modules that setup.py compiles where there is a compiler
COMPILED_NAMES = ['.'.join(path.relative_to(PACKAGE.parent).with_suffix('').parts)
                  for path in sorted(PACKAGE.rglob('*.py'))
                  if '\nCOMPILED: bool = cython.compiled\n' in path.read_text('utf-8')]


class SourceFinder:
    """Imports the modules that are compiled as Python, once it is first in ``sys.meta_path``."""

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        """Return how ``name`` is imported, if it is such a module."""
        file = PACKAGE.parent.joinpath(*name.split('.')).with_suffix('.py')
        return spec_from_file_location(name, file) if name in COMPILED_NAMES else None


def source(module: ModuleType) -> Path:
    """Return the Python file of a module."""
    return PACKAGE.parent.joinpath(*module.__name__.split('.')).with_suffix('.py')


def load_source(module: ModuleType) -> ModuleType:
    """Return the module as Python, although it is compiled, with the tire forces as Python."""
    spec = spec_from_file_location(f'{module.__name__}_source', source(module))
    assert spec and spec.loader
    loaded = module_from_spec(spec)
    forces = {} if module is brush_tire else {brush_tire.__name__: load_source(brush_tire)}
    with patch.dict(sys.modules, {spec.name: loaded, **forces}):
        spec.loader.exec_module(loaded)
    assert not loaded.COMPILED
    return loaded
