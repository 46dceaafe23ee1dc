# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Test modules in real time, by the marker of the module: they run in two chains."""

from __future__ import annotations

import re

GROUPS = ('processes', 'safety')  # markers, declared in pyproject.toml
MODULE_MARK = re.compile(rf'^pytestmark = .*\bpytest\.mark\.({"|".join(GROUPS)})\b', re.MULTILINE)
FIRST_CHAIN = ('test/nodes/', 'test/cli/')  # about half of the time of all modules with a marker


def group_of(text: str) -> str | None:
    """Return the group of a test module from its source; None for a module without group."""
    match = MODULE_MARK.search(text)
    return match[1] if match else None


def chain_of(file: str, text: str) -> str | None:
    """
    Return the chain of a test module, whose modules run one after the other on one worker.

    The process that assigns tests to workers collects none, and the groups of xdist 3.8 have no
    effect with pytest 9.2: xdist sets an attribute of the items that pytest no longer reads.
    """
    if not group_of(text):
        return None
    return 'first chain' if file.startswith(FIRST_CHAIN) else 'second chain'
