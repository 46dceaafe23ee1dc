# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Rules of an SROS2 policy."""

from __future__ import annotations

from collections import defaultdict
from xml.etree import ElementTree


def rules_in(policy: str) -> dict[str, dict[tuple[str, str], set[str]]]:
    """Return node -> such as ('topics', 'publish') -> absolute names."""
    found: dict[str, dict[tuple[str, str], set[str]]] = {}
    for profile in ElementTree.fromstring(policy.encode()).iter('profile'):
        node, space = profile.attrib['node'], profile.attrib['ns'].rstrip('/')
        rules = found[node] = defaultdict(set)
        for rule in profile:
            ((role, effect),) = rule.attrib.items()
            assert effect == 'ALLOW'  # what is not listed is denied
            rules[rule.tag, role] |= {
                name if name.startswith('/') else f'{space}/{node}{name[1:]}'
                if name.startswith('~') else f'{space}/{name}'
                for name in (item.text or '' for item in rule)}
    return found
