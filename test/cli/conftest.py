"""What the tests of the command share."""

from __future__ import annotations

import pytest

from smart_tire.cli.stack import isolated_environment


@pytest.fixture
def dds():
    """Return an environment whose DDS nobody else hears."""
    return isolated_environment()
