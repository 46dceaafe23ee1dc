# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""YAML from outside, which may be damaged: a value or yaml.YAMLError."""

from __future__ import annotations

import re
from typing import Any

import yaml

MAX_DEPTH = 100  # of nested collections: the C loader overflows its stack at some 10,000 levels
NUMBER = re.compile(r'[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?$')
BASE: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)  # compiled, 10 times as fast


class Loader(BASE):
    """YAML loader that reads 1e-3 as a number, as rcl and YAML 1.2 do."""


Loader.add_implicit_resolver('tag:yaml.org,2002:float', NUMBER, list('-+.0123456789'))


def load_own(text: str) -> Any:
    """Return the value of a YAML text of this package, which needs no checks."""
    return yaml.load(text, BASE)


def parse_yaml(text: str) -> Any:
    """Return the value of ``text``; raise yaml.YAMLError if it is not valid YAML."""
    depth = 0
    try:
        for event in yaml.parse(text, Loader):
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > MAX_DEPTH:
                raise yaml.YAMLError(f'nested deeper than {MAX_DEPTH} levels')
        return yaml.load(text, Loader)
    # The constructors raise these for an impossible date or a tag that does not fit its text.
    except (ValueError, LookupError, AttributeError, TypeError, RecursionError) as error:
        raise yaml.YAMLError(str(error)) from error
