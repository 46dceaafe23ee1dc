# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A FIFO, device or socket in the place of a file: refused in one line, with exit status 2."""

from __future__ import annotations

import pytest
from smart_tire.cli.main import main
from support.special_files import KINDS, special_file

OUT = ['--out', 'OUT']
VERBS = [
    ['analyze', 'FILE', *OUT], ['analyze', 'BAG', '--params', 'FILE', *OUT],
    ['recover', 'FILE', *OUT], ['compare', 'FILE'], ['compare', 'BAG', '--truth', 'FILE'],
    ['compare', 'BAG', '--params', 'FILE'],
    ['view', 'FILE'], ['report', 'FILE', *OUT], ['doctor', 'FILE'],
    ['doctor', '--params', 'FILE'], ['replay', 'FILE'], ['record', '--params', 'FILE', *OUT],
    ['robot', '--params', 'FILE'], ['drive', '--path', 'square', '--params', 'FILE', *OUT],
    ['drive', '--path', 'FILE', *OUT], ['drive', '--path', 'FILE.mcap', *OUT],
    ['identify', 'geometry', 'FILE', *OUT], ['identify', 'film', 'FILE', *OUT],
    ['measure', 'film', 'FILE', '--params', 'BAG', *OUT],
    ['measure', 'film', 'BAG', '--params', 'FILE', *OUT],
    ['calibrate', '--bags', 'straight=FILE', *OUT]]


@pytest.mark.parametrize('words', VERBS, ids=' '.join)
@pytest.mark.parametrize('kind', KINDS)
def test_only_regular_files_are_read(kind, words, tmp_path, capsys):
    with special_file(kind, tmp_path) as file:
        (tmp_path / 'file.mcap').symlink_to(file)
        regular = tmp_path / 'regular.mcap'
        regular.touch()
        names = {'FILE.mcap': tmp_path / 'file.mcap', 'FILE': file, 'BAG': regular,
                 'OUT': tmp_path / 'out'}
        given = words
        for name, path in names.items():
            given = [word.replace(name, str(path)) for word in given]
        assert main(given) == 2
    printed = capsys.readouterr().err
    assert printed.startswith(f'smart_tire {words[0]}: ')
    assert printed.count('\n') == 1
    assert printed.endswith('(not a regular file)\n')
