# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The compiled modules are compiled, from their present source."""

from importlib import import_module
import os
from pathlib import Path
import shutil
import sys
import sysconfig

import pytest
from smart_tire.estimation.slip.estimator import COMPILED, SlipEstimator
from smart_tire.parameters import SlipEstimatorParams
from support.compiled import COMPILED_NAMES, load_source, source

MODULES = [import_module(name) for name in COMPILED_NAMES]
BUILT_BY_MAKE = not os.environ.keys() & {'ROS_DISTRO', 'SMART_TIRE_NO_COMPILER'} \
    and shutil.which('gcc') and Path(sysconfig.get_path('include'), 'Python.h').exists()


@pytest.mark.skipif(not BUILT_BY_MAKE, reason='no compiler, or not built by make')
@pytest.mark.parametrize('module', MODULES)
def test_it_is_compiled_where_there_is_a_compiler(module):
    assert module.COMPILED, 'run make; the reason is in the log of "pip install -v --editable ."'


@pytest.mark.parametrize('module', MODULES)
def test_the_extension_is_newer_than_its_source(module):
    assert not module.COMPILED or (
        Path(module.__file__).stat().st_mtime >= source(module).stat().st_mtime), 'run make'


@pytest.mark.parametrize('module', MODULES)
def test_it_runs_without_cython(module, monkeypatch):
    monkeypatch.setitem(sys.modules, 'cython', None)
    assert not load_source(module).COMPILED


def test_diagnostics_say_whether_they_are_compiled():
    status = SlipEstimator(SlipEstimatorParams()).status()
    assert (status['equations'] == 'compiled') == COMPILED
