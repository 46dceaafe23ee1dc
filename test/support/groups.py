"""Test modules that run one after the other, on one worker: by the marker of the module."""

from __future__ import annotations

import re

GROUPS = ('processes', 'safety')  # markers, declared in pyproject.toml
MODULE_MARK = re.compile(rf'^pytestmark = .*\bpytest\.mark\.({"|".join(GROUPS)})\b', re.MULTILINE)


def group_of(text: str) -> str | None:
    """
    Return the group of a test module from its source; None for a module without group.

    The process that assigns tests to workers collects none, and the groups of xdist 3.8 have no
    effect with pytest 9.2: xdist sets an attribute of the items that pytest no longer reads.
    """
    match = MODULE_MARK.search(text)
    return match[1] if match else None
