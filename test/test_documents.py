# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The documents: links, cited modules, equations and tables agree with the repository."""

from __future__ import annotations

from pathlib import Path
import re

from architecture_tables import read_imports, read_levels
from draw_architecture import check_nodes, check_rooms, read_nodes, with_imports

from smart_tire.messages import TOPICS
from smart_tire.parameters import known_names, NODE_PARAMS
from smart_tire.samples import FRICTION_QUANTITIES

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = sorted([*ROOT.glob('*.md'), *(ROOT / 'docs').glob('*.md')])
SOURCES = [path for folder in ('smart_tire', 'benchmarks')
           for path in sorted((ROOT / folder).rglob('*.py'))]
MAX_README_WORDS = 700
LINK = re.compile(r'\]\(([^)\s]+)\)')
CODE = re.compile(r'`([^`\n]+)`')
FILE = re.compile(r'(?:[\w.-]+/)+[\w.-]+\.(?:py|md|yaml|rst|txt|svg)')
EQUATION = re.compile(r'\b([AB])\((\d+)[a-d]?\)')
EQUATION_RANGE = re.compile(r'\b([AB])\((\d+)[a-d]?\) to [AB]\((\d+)[a-d]?\)')
PARAMETERS = known_names(NODE_PARAMS.values())
ROOMS = {path.name.removesuffix('.py') for path in (ROOT / 'smart_tire').iterdir()}


def text_of(name: str) -> str:
    """Return the text of a document."""
    return (ROOT / name).read_text(encoding='utf-8')


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


def test_links_between_documents_have_a_target():
    assert [link for path in DOCUMENTS for link in broken_links(path)] == []


def test_files_that_documents_cite_exist():
    assert [name for path in DOCUMENTS for name in missing_files(path)] == []


def test_modules_that_documents_cite_exist():
    assert [name for path in DOCUMENTS for name in missing_modules(path)] == []


def test_the_readme_is_short():
    assert len(text_of('README.md').split()) <= MAX_README_WORDS


def test_every_command_of_make_is_in_its_help_and_in_contributing():
    makefile = text_of('Makefile')
    phony = makefile.partition('.PHONY:')[2].partition('\nhelp:')[0].replace('\\', ' ').split()
    commands = set(phony) - {'help', 'setup', 'current'}  # parts of others
    assert commands == set(re.findall(r"@echo 'make ([a-z-]+) ", makefile))
    assert commands <= set(re.findall(r'`make ([a-z-]+)`', text_of('CONTRIBUTING.md')))


def test_every_equation_cited_in_the_source_is_in_the_table_of_equations():
    rows = text_of('docs/theory.md').partition('## Equations and modules')[2]
    listed = {(paper, int(number)) for paper, number in EQUATION.findall(rows)}
    for paper, first, last in EQUATION_RANGE.findall(rows):
        listed |= {(paper, number) for number in range(int(first), int(last) + 1)}
    cited = {(paper, int(number)) for path in SOURCES
             for paper, number in EQUATION.findall(path.read_text(encoding='utf-8'))}
    assert cited and cited <= listed, sorted(cited - listed)


def test_every_topic_and_quantity_of_the_contract_is_described():
    text = text_of('docs/topics.md')
    assert [name for name in [*TOPICS, *FRICTION_QUANTITIES] if f'`{name}`' not in text] == []


def test_the_architecture_has_every_room_node_and_import_of_the_source():
    text = text_of('docs/architecture.md')
    levels, imports = read_levels(text), read_imports()
    check_rooms(levels, imports)
    check_nodes(read_nodes(text))
    assert with_imports(text, levels, imports) == text, 'run docs/draw_architecture.py'
    picture = text_of('docs/architecture.svg')
    assert [room for room in imports if room not in picture] == []
