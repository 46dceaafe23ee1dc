# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The documents: links, cited modules, equations and tables agree with the repository."""

from __future__ import annotations

from pathlib import Path
import re
import shlex

import animation
from architecture_tables import read_imports, read_levels
from command_line_page import verbs_text
from draw_architecture import check_nodes, check_rooms, read_nodes
from PIL import Image
import pytest

from smart_tire import errors, yaml_text
from smart_tire.bags import file_bytes
from smart_tire.cli import _path_file
from smart_tire.cli.main import new_parser, VERBS
from smart_tire.messages import TOPICS
from smart_tire.papers.film_files import MAX_TABLE_SIZE
from smart_tire.parameters import known_names, NODE_PARAMS
from smart_tire.protocol.tire_payload import decode_batch
from smart_tire.protocol.xbee import decode_receive_packet, XBeeDeframer
from smart_tire.samples import FRICTION_QUANTITIES
from support.yaml_attacks import ATTACKS
import theory_page
from topics_page import details

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = sorted([*ROOT.glob('*.md'), *(ROOT / 'docs').rglob('*.md')])
# Pages whose Python code runs, block after block, without other files.
PROGRAMS = sorted(path.relative_to(ROOT / 'docs').as_posix() for folder in (
    'tutorials', 'how_to', 'reference') for path in (ROOT / 'docs' / folder).glob('*.md')
    if '```python' in path.read_text(encoding='utf-8'))
SOURCES = [path for folder in ('smart_tire', 'benchmarks')
           for path in sorted((ROOT / folder).rglob('*.py'))]
MAX_README_WORDS = 700
MAX_ANIMATION_SIZE = 200_000  # bytes
LINK = re.compile(r'\]\((?!https?:)([^)\s]+)\)')
CODE = re.compile(r'`([^`\n]+)`')
FENCE = re.compile(r'^```(\w*)\n(.*?)^```', re.MULTILINE | re.DOTALL)
FILE = re.compile(r'(?:[\w.-]+/)+[\w.-]+\.(?:py|md|yaml|rst|txt|svg)')
EQUATION = re.compile(r'\b([AB])\((\d+)[a-d]?\)')
EQUATION_RANGE = re.compile(r'\b([AB])\((\d+)[a-d]?\) to [AB]\((\d+)[a-d]?\)')
PARAMETERS = known_names(NODE_PARAMS.values())
ROOMS = {path.name.removesuffix('.py') for path in (ROOT / 'smart_tire').iterdir()}


def text_of(name: str) -> str:
    """Return the text of a document."""
    return (ROOT / name).read_text(encoding='utf-8')


def fenced(path: Path, *languages: str) -> list[str]:
    """Return the fenced blocks of a document in some languages."""
    return [code for language, code in FENCE.findall(path.read_text(encoding='utf-8'))
            if language in languages]


def commands(path: Path) -> list[list[str]]:
    """Return the words of each ``smart_tire`` command in the shell blocks of a document."""
    lines = '\n'.join(fenced(path, 'bash')).replace('\\\n', ' ').splitlines()
    words = [shlex.split(line, comments=True) for line in lines if 'smart_tire ' in line]
    return [found[found.index('smart_tire') + 1:] for found in words
            if 'smart_tire' in found and found[0] in ('smart_tire', '.venv/bin/smart_tire')]


def source_literals() -> str:
    """Return the source of package and Makefile with adjacent string literals joined."""
    text = '\n'.join(path.read_text(encoding='utf-8') for path in [*SOURCES, ROOT / 'Makefile'])
    return re.sub(r"'\s*(#[^\n]*)?\s*(?:\+ )?f?'", '', text)


def anchors(path: Path) -> set[str]:
    """Return the anchors of a document's headings, as GitHub makes them."""
    headings = re.findall(r'^#+ (.+)$', path.read_text(encoding='utf-8'), re.MULTILINE)
    return {re.sub(r'[^\w\- ]', '', heading.lower()).replace(' ', '-') for heading in headings}


def broken_links(path: Path) -> list[str]:
    """Return the relative links of a document that have no target."""
    broken = []
    for link in LINK.findall(path.read_text(encoding='utf-8')):
        name, _, anchor = link.partition('#')
        target = (path.parent / name).resolve() if name else path
        if not target.is_file() or anchor and anchor not in anchors(target):
            broken.append(f'{path.name}: {link}')
    return broken


def missing_files(path: Path) -> list[str]:
    """Return the files that a document cites in code spans and that do not exist."""
    return [f'{path.name}: {name}' for span in CODE.findall(path.read_text(encoding='utf-8'))
            for name in FILE.findall(span)
            if not span.startswith(('~', 'demo_output/', 'bench_output/', 'results/'))
            and '*' not in span and '<' not in span
            and not (ROOT / name).exists() and not (ROOT / 'smart_tire' / name).exists()]


def missing_modules(path: Path) -> list[str]:
    """Return the dotted modules that a document cites in code spans and that do not exist."""
    missing = []
    for span in CODE.findall(path.read_text(encoding='utf-8')):
        name = span.removeprefix('smart_tire.')
        parts = name.split('.')
        if not re.fullmatch(r'[a-z_]+(\.[a-z_]+)+', name) or parts[0] not in ROOMS \
                or parts[-1] in ('py', 'yaml', 'md') or span in PARAMETERS:
            continue
        module = ROOT.joinpath('smart_tire', *parts)
        if not module.with_suffix('.py').is_file() and not module.is_dir():
            missing.append(f'{path.name}: {span}')
    return missing


def open_code_blocks(text: str) -> list[int]:
    """Return the lines of headings inside a code block that was not ended."""
    inside, found = False, []
    for number, line in enumerate(text.splitlines(), 1):
        inside ^= line.startswith('```')
        if inside and line.startswith('## '):
            found.append(number)
    return found


def test_code_blocks_end_before_the_next_section():
    assert open_code_blocks('```\na\n\n## B\n```') == [4]
    assert {path.name: lines for path in DOCUMENTS
            if (lines := open_code_blocks(path.read_text(encoding='utf-8')))} == {}


def test_links_between_documents_have_a_target():
    assert [link for path in DOCUMENTS for link in broken_links(path)] == []


def test_files_that_documents_cite_exist():
    assert [name for path in DOCUMENTS for name in missing_files(path)] == []


def test_modules_that_documents_cite_exist():
    assert [name for path in DOCUMENTS for name in missing_modules(path)] == []


def test_the_readme_is_short():
    assert len(text_of('README.md').split()) <= MAX_README_WORDS


def test_the_readme_shows_a_small_animation_with_its_command():
    readme = text_of('README.md')
    name, = re.findall(r'!\[[^]]+\]\((.+?)\)', readme)
    assert ROOT / name == animation.PICTURE
    assert animation.PICTURE.stat().st_size < MAX_ANIMATION_SIZE
    with Image.open(animation.PICTURE) as picture:
        assert picture.n_frames > 10
    assert 'python docs/animation.py demo_output ' in readme


def test_every_command_of_make_is_in_its_help_and_in_contributing():
    makefile = text_of('Makefile')
    phony = makefile.partition('.PHONY:')[2].partition('\nhelp:')[0].replace('\\', ' ').split()
    commands = set(phony) - {'help', 'setup', 'current', 'pytest'}  # parts of others
    assert commands == set(re.findall(r"@echo 'make ([a-z-]+) ", makefile))
    assert commands <= set(re.findall(r'`make ([a-z-]+)`', text_of('CONTRIBUTING.md')))


def test_the_numbers_of_the_theory_are_those_of_the_package():
    text = text_of('docs/theory.md')
    assert theory_page.current(text) == text, 'run docs/theory_page.py'


def test_a_number_is_rounded_as_in_the_text():
    constants = ['estimation.ground.unknowns.LENGTH', 'control.constants.RESISTANCE[0] * 100']
    assert theory_page.written('for 7.25 s\nand 0 %.', {'for # s and # %': constants}) == (
        'for 3.00 s\nand 1 %.')
    with pytest.raises(ValueError, match='theory.md has no "of # s"'):
        theory_page.written('for 3 s', {'of # s': constants[0]})


def test_every_equation_cited_in_the_source_is_in_the_table_of_equations():
    rows = text_of('docs/theory.md').partition('## Equations and modules')[2]
    listed = {(paper, int(number)) for paper, number in EQUATION.findall(rows)}
    for paper, first, last in EQUATION_RANGE.findall(rows):
        listed |= {(paper, number) for number in range(int(first), int(last) + 1)}
    cited = {(paper, int(number)) for path in SOURCES
             for paper, number in EQUATION.findall(path.read_text(encoding='utf-8'))}
    assert cited and cited <= listed, sorted(cited - listed)


def test_every_topic_and_quantity_of_the_contract_is_described():
    text = text_of('docs/topics.md') + details({})
    assert [name for name in [*TOPICS, *FRICTION_QUANTITIES] if f'`{name}`' not in text] == []


def test_the_architecture_has_every_room_and_node_of_the_source():
    text = text_of('docs/architecture.md')
    levels, imports = read_levels(text), read_imports()
    check_rooms(levels, imports)
    check_nodes(read_nodes(text))
    picture = text_of('docs/architecture.svg')
    assert [room for room in imports if room not in picture] == []


@pytest.mark.parametrize('path', DOCUMENTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_every_command_in_a_document_is_accepted_by_its_parser(path):
    for words in commands(path):
        assert words[0] in VERBS, words
        assert new_parser().parse_args(words).verb == words[0]


def test_commands_are_found():
    found = [words for path in DOCUMENTS for words in commands(path)]
    assert len(found) > 15 and {words[0] for words in found} >= {'analyze', 'identify', 'record'}


def test_a_wrong_command_is_refused(tmp_path):
    (tmp_path / 'a.md').write_text('```bash\nsmart_tire record --nowhere \\\n  x  # why\n```\n')
    [words] = commands(tmp_path / 'a.md')
    assert words == ['record', '--nowhere', 'x']
    with pytest.raises(SystemExit):
        new_parser().parse_args(words)


def test_messages_in_troubleshooting_are_those_of_the_software():
    source = source_literals()
    rows = [line for line in text_of('docs/troubleshooting.md').splitlines()
            if line.startswith('| ')]
    messages = [span for row in rows for span in CODE.findall(row.split(' | ')[0])
                if ' ' in span]
    parts = [part.strip() for message in messages for part in message.split('...')]
    assert len(messages) > 20
    assert [part for part in parts if part and part not in source] == []


def test_the_payload_in_the_document_is_that_of_the_decoder():
    table, frame = [block for block in fenced(ROOT / 'docs' / 'hardware.md', 'text')
                    if re.match('[0-9a-f]{2} ', block)]
    payload = bytes.fromhex(' '.join(line[:11] for line in table.splitlines()))
    batch = decode_batch(payload)
    assert (batch.sequence, batch.timer_us, batch.period_us, batch.battery_mv) == (
        258, 1_000_000, 2500, 3700)
    assert batch.codes == ((511, 512), (514, 512)) and not batch.saturated
    [body] = XBeeDeframer().extract(bytes.fromhex(frame))
    packet = decode_receive_packet(body)
    assert packet.data == payload and packet.source == 0x0013A20040A1B2C3


@pytest.mark.parametrize('name', PROGRAMS)
def test_the_python_code_of_a_page_runs(name):
    names: dict[str, object] = {'__name__': '__main__'}  # a module that dataclasses know
    for number, block in enumerate(fenced(ROOT / 'docs' / name, 'python')):
        exec(compile(block, f'{name}, block {number}', 'exec'), names)


def test_every_verb_is_in_the_reference_of_the_command():
    text = verbs_text()
    for verb in VERBS:
        assert f'## smart_tire {verb}\n' in text
    assert '### smart_tire identify gains\n' in text
    assert '| `--rate R` | speed relative to the recording' in text
    assert '%(' not in text


def test_the_bounds_in_the_security_page_are_those_of_the_source():
    text = ' '.join((ROOT / 'docs' / 'security.md').read_text(encoding='utf-8').split())
    for bound in (
            f'| {yaml_text.MAX_SIZE / 1e6:.0f} MB, {yaml_text.MAX_DEPTH} nested levels',
            f'in memory | {file_bytes.MAX_SIZE / 1e6:.0f} MB |',
            f'| {file_bytes.MAX_FILE_SIZE >> 30} GB, or {file_bytes.MAX_RATIO} times',
            f'| {MAX_TABLE_SIZE / 1e6:.0f} MB, {_path_file.MAX_SIZE / 1e6:.0f} MB |',
            f'| {errors.MAX_TEXT} characters', f'({len(ATTACKS)} parameter files)'):
        assert bound in text
