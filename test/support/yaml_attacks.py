# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Parameter files that attack their reader: each is refused in one line, with the file."""

from __future__ import annotations

HEAD, TAIL = '/**: {ros__parameters: {mass: ', '}}\n'  # around the value of a parameter
DEEP = 100_000    # nested collections
MANY = 200_000    # repetitions, together some MB
LONG = 500_000    # characters, less than 1 MB


def value(text: str) -> bytes:
    """Return a parameter file with ``text`` as the value of a number."""
    return f'{HEAD}{text}{TAIL}'.encode()


def alias_bomb(kind: str, levels: int = 30) -> bytes:
    """Return a parameter file with 2**levels values, of lists or mappings."""
    lines = ['a0: &a0 1']
    for level in range(1, levels):
        items = {'list': f'[*a{level - 1}, *a{level - 1}]',
                 'mapping': f'{{x: *a{level - 1}, y: *a{level - 1}}}',
                 'merge': f'{{<<: [*a{level - 1}, *a{level - 1}], k{level}: 1}}'}[kind]
        lines.append(f'a{level}: &a{level} {items}')
    if kind == 'merge':
        lines[0] = 'a0: &a0 {k: 1}'
    return ('\n'.join(lines) + f'\n/**: {{ros__parameters: *a{levels - 1}}}\n').encode()


ATTACKS = {
    # of the syntax
    'empty': b'',
    'comment': b'# nothing',
    'null': b'~',
    'number': b'3',
    'text': b'mass',
    'list': b'[/**, ros__parameters]',
    'open list': b'/**: {ros__parameters: {mass: [1, 2',
    'open quote': b'/**: {ros__parameters: {mass: "1',
    'tab': b'/**:\n\tros__parameters:\n\t\tmass: 1\n',
    'indentation': b'/**:\n   ros__parameters:\n  mass: 1\n',
    'colons': b'/**: ros__parameters: mass: 1\n',
    'two documents': b'/**: {ros__parameters: {mass: 7.0}}\n---\n/**: {ros__parameters: {}}\n',
    'version': b'%YAML 9.9\n---\n/**: {ros__parameters: {mass: 7.0}}\n',
    'escape': b'"/**": {ros__parameters: {mass: "\\q"}}',
    # of the characters
    'NUL': b'/**: {ros__parameters: {mass: \0}}',
    'bell': b'/**: {ros__parameters: {base_frame: "\a"}}',
    'terminal control': b'/**: {ros__parameters: {"\\e[2J\\e[31m": 1}}',
    'line breaks': b'/**: {ros__parameters: {"a\\nb\\nc\\r\\nd\\u2028e": 1}}',
    'not UTF-8': b'/**: {ros__parameters: {base_frame: \xff\xfe}}',
    'Latin-1': '/**: {ros__parameters: {base_frame: Räder}}'.encode('latin-1'),
    'UTF-16': '/**: {ros__parameters: {mass: 7.0}}'.encode('utf-16'),
    'UTF-32': '/**: {ros__parameters: {mass: 7.0}}'.encode('utf-32'),
    'surrogate': b'/**: {ros__parameters: {base_frame: "\\uD800"}}',
    'byte order mark inside': b'/**: {ros__parameters: {mass: \xef\xbb\xbf7.0}}',
    # of the tags
    'python object': value('!!python/object/apply:os.system ["true"]'),
    'python tuple': value('!!python/tuple [1, 2]'),
    'unknown tag': value('!weight 7.0'),
    'undeclared handle': value('!a!b 7.0'),
    'binary': value('!!binary "=="'),
    'binary of a list': value('!!binary [a]'),
    'time': value('!!timestamp noon'),
    'impossible date': value('2001-99-99'),
    'integer of a text': value('!!int seven'),
    'float of a text': value('!!float seven'),
    'bool of a text': value('!!bool seven'),
    'mapping of a list': value('!!map [1]'),
    'ordered mapping': value('!!omap [1]'),
    'pairs': value('!!pairs [1]'),
    'set of a list': value('!!set [1]'),
    # of the numbers
    'long integer': value('9' * 5000),
    'longer integer than a float': value('9' * 400),
    'integer of a hundred thousand hexadecimal digits': value('0x' + 'f' * 100_000),
    'integer of a hundred thousand bits': value('0b' + '1' * 100_000),
    'sexagesimal integer': value(':'.join(['59'] * 100_000)),
    'infinite': value('1e999'),
    'NaN': value('.nan'),
    'long text': value('"' + 'x' * LONG + '"'),
    # of the keys
    'list as key': b'/**: {ros__parameters: {? [a] : 1}}',
    'mapping as key': b'/**: {ros__parameters: {? {a: b} : 1}}',
    'number as key': b'/**: {ros__parameters: {1: 1}}',
    'long name': f'/**: {{ros__parameters: {{? {"x" * LONG} : 1}}}}'.encode(),
    'long block': f'? {"x" * LONG}\n: 1'.encode(),
    'many wildcards': f'? {"/**" * 100_000}\n: {{ros__parameters: {{mass: -1.0}}}}'.encode(),
    'many blocks': b''.join(b'b%d: {ros__parameters: {}}\n' % number
                            for number in range(30_000)) + value('-1.0'),
    'many parameters': ('/**: {ros__parameters: {' + ''.join(
        f'p{number}: 1, ' for number in range(60_000)) + '}}').encode(),
    # of anchors and aliases
    'aliases of lists': alias_bomb('list'),
    'aliases of mappings': alias_bomb('mapping'),
    'aliases in merge keys': alias_bomb('merge', 20),
    'list in itself': b'/**: {ros__parameters: {mass: &a [*a]}}',
    'mapping in itself': b'/**: &a {ros__parameters: *a}',
    'merge of itself': b'/**: {ros__parameters: &a {<<: *a}}',
    'merge of a number': b'/**: {ros__parameters: {<<: 1}}',
    'undefined alias': value('*a'),
    'second anchor of a name': b'a: &a 1\nb: &a 2\n/**: {ros__parameters: {mass: *a}}',
    'alias': b'a: &a 7.0\n/**: {ros__parameters: {mass: *a}}',
    # of the size
    'deep lists': value('[' * DEEP + ']' * DEEP),
    'open deep lists': value('[' * DEEP),
    'deep mappings': value('{a: ' * DEEP + '1' + '}' * DEEP),
    'deep blocks': '\n'.join(f'{" " * level}a:' for level in range(1000)).encode(),
    'deep lists of one line': b'- ' * DEEP,
    'deep keys': b'? ' * DEEP,
    '51 levels': value('[' * 51 + ']' * 51),
    'two megabytes': b'# ' + b'x' * 2_000_000 + b'\n' + value('7.0'),
    'many small values': b'/**: {ros__parameters: {film.wheels: [' + b'a,' * MANY + b']}}',
}
