"""Tests for all kinds of ``smart_tire identify``."""

from __future__ import annotations

import argparse
from importlib import import_module

import pytest

from smart_tire.cli import identify


def parsed(*words):
    parser = argparse.ArgumentParser()
    identify.add_arguments(parser)
    return parser.parse_args(words)


@pytest.mark.parametrize('kind', identify.KINDS)
def test_each_kind_has_a_module_of_its_name(kind):
    module = import_module(f'smart_tire.cli._identify_{kind}')
    assert kind == module.NAME
    assert parsed(kind, 'some_recording').run_kind is module.run


def test_an_unknown_kind_is_a_usage_error_that_lists_the_known_ones(capsys):
    with pytest.raises(SystemExit) as left:
        parsed('colour', 'some_recording')
    assert left.value.code == 2
    output = capsys.readouterr().err
    assert all(kind in output for kind in identify.KINDS)
