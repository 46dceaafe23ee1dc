# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Draw ``docs/architecture.svg``: the flow of data between nodes, and the imports between rooms.

Imports and topics are read from the source with ``ast``; nothing of the package is imported. The
level of each room and the inputs and outputs of each node come from the tables of
``docs/architecture.md`` and are checked against the source.
Run ``python docs/draw_architecture.py [FILE]``; the suffix of FILE selects the format.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
import math
from pathlib import Path
import sys

from architecture_tables import DOCUMENT, Edges, PACKAGE, parse, read_imports, read_levels, ROOT, \
    table
import matplotlib
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch
import matplotlib.pyplot as plt

FIGURE_SIZE = (12.5, 13.8)  # in
PANEL_RATIO = (6.5, 7.3)    # height of the data flow over that of the rooms
BOX_HEIGHT = 0.62           # of the distance between two rows, at most
COLUMN_WIDTHS, COLUMN_GAP = (1.7, 1.9, 2.45, 2.15, 2.6), 0.95  # in rows
COLUMN_KINDS = ('device', 'driver', 'topic', 'node', 'topic')
COLUMN_TITLES = ('devices', 'drivers', 'measurements, commands', 'estimation, control',
                 'estimates, commands')
COLORS = {'device': '#d9d9d9', 'driver': '#cfe2f3', 'topic': '#ffffff', 'node': '#d9ead3',
          'room': '#f3f3f3'}
FONTS = ['DejaVu Sans', 'Verdana', 'Arial', 'Helvetica']  # the first one that a viewer has

COLUMNS = 6             # of rooms
ROOM_SIZE = (0.86, 0.56)  # of the distance between columns, and between levels
SAME_LEVEL_BEND = 0.08  # height over length of an arrow within a level
CENTERING = 0.05        # cost of a column away from the middle, in columns of arrow length
CLEARANCE = 0.6         # columns between an arrow and the center of a room that it passes

Spot = tuple[float, float]  # column and level


@dataclass(frozen=True)
class NodeRow:
    """One row of the table of nodes: names as in the source."""

    name: str
    device: str                  # '' where there is none
    subscribes: tuple[str, ...]  # topics
    publishes: tuple[str, ...]   # topics


@dataclass(frozen=True)
class Box:
    """A labelled rectangle: center and size in the units of its axes."""

    x: float
    y: float
    width: float
    height: float


def read_nodes(text: str) -> list[NodeRow]:
    """Return the rows of the table of nodes."""
    return [NodeRow(name.strip('`'), device, *(tuple(cell.replace('`', '').replace(',', ' ')
                                                     .split()) for cell in (reads, writes)))
            for name, device, reads, writes in table(text, 'nodes')]


def reduced(edges: Edges) -> Edges:
    """Return ``edges`` without those that a longer path implies."""
    def reach(start: str) -> set[str]:
        seen: set[str] = set()
        stack = [start]
        while stack:
            for other in edges.get(stack.pop(), set()) - seen:
                seen.add(other)
                stack.append(other)
        return seen

    return {room: {other for other in others
                   if not any(other in reach(via) for via in others - {other})}
            for room, others in edges.items()}


def string_constants(tree: ast.AST) -> set[str]:
    """Return the string literals in a syntax tree."""
    return {node.value for node in ast.walk(tree)
            if isinstance(node, ast.Constant) and isinstance(node.value, str)}


def estimator_topics() -> dict[str, set[str]]:
    """Return node -> topics that ``estimation/streams.py`` declares for its estimator."""
    return {f'{target.id.lower()}_{kind}': string_constants(node.value)
            for kind in ('estimator', 'sensor')
            for node in parse(PACKAGE / 'estimation' / 'streams.py').body
            if isinstance(node, ast.Assign) for target in node.targets
            if isinstance(target, ast.Name)}


def contract_topics() -> set[str]:
    """Return the names of the topics that ``messages/topics.py`` declares."""
    found = set()
    for node in ast.walk(parse(PACKAGE / 'messages' / 'topics.py')):
        if isinstance(node, ast.Call) and getattr(node.func, 'id', '') == 'Topic':
            name = node.args[0]
            assert isinstance(name, ast.Constant)
            found.add(str(name.value))
    return found


def check_rooms(levels: Mapping[str, int], imports: Edges) -> None:
    """Raise ValueError where a room has no level."""
    if missing := imports.keys() - levels.keys():
        raise ValueError(f'{DOCUMENT.name} gives no level for {", ".join(sorted(missing))}')


def check_nodes(rows: Iterable[NodeRow]) -> None:
    """Raise ValueError where the table of nodes and the source of a node disagree."""
    topics, estimators = contract_topics(), estimator_topics()
    for row in rows:
        source = parse(PACKAGE / 'nodes' / f'{row.name}.py')
        constants = string_constants(source) | estimators.get(row.name, set())
        listed = {*row.subscribes, *row.publishes}
        if unknown := {name for name in listed if name not in constants
                       and not any(name.startswith(f'{word.rstrip("/")}/') for word in constants
                                   if word.endswith('/'))}:
            raise ValueError(f'{row.name} does not mention {", ".join(sorted(unknown))}')
        if missing := constants & topics - listed:
            raise ValueError(f'table lacks {", ".join(sorted(missing))} of {row.name}')


def draw_box(ax: Axes, box: Box, label: str, color: str, *, note: str = '',
             rounded: bool = True) -> None:
    """Draw a rectangle with a label and a smaller note below it."""
    ax.add_patch(FancyBboxPatch(
        (box.x - 0.5 * box.width, box.y - 0.5 * box.height), box.width, box.height,
        boxstyle='round,pad=0,rounding_size=0.06' if rounded else 'square,pad=0',
        facecolor=color, edgecolor='#444444', linewidth=0.9, zorder=3))
    shift = 0.2 * box.height if note else 0.0
    ax.text(box.x, box.y + shift, label, ha='center', va='center', fontsize=9, zorder=4,
            fontweight='bold' if note else 'normal')
    if note:
        ax.text(box.x, box.y - 0.22 * box.height, note, ha='center', va='center', fontsize=6.8,
                color='#333333', zorder=4, linespacing=1.15)


def draw_arrow(ax: Axes, tail: tuple[float, float], head: tuple[float, float], *,
               color: str = '#555555', dashed: bool = False, bend: float = 0.0) -> None:
    """Draw an arrow between two points; ``bend`` is its height over its length."""
    ax.add_patch(FancyArrowPatch(
        tail, head, arrowstyle='-|>', connectionstyle=f'arc3,rad={bend}', mutation_scale=9,
        linewidth=0.9, color=color, zorder=2, shrinkA=0, shrinkB=1,
        linestyle=(0, (4, 2)) if dashed else 'solid'))


def columns_of(rows: Iterable[NodeRow]) -> list[list[str]]:
    """Return devices, drivers, their topics, other nodes, and the topics of these."""
    rows = list(rows)
    drivers = [row for row in rows if row.device]
    others = [row for row in rows if not row.device]
    inputs = list(dict.fromkeys(topic for row in drivers for topic in row.publishes))
    outputs = list(dict.fromkeys(topic for row in others for topic in row.publishes))
    commands = [topic for row in others for topic in row.subscribes
                if topic not in inputs and topic not in outputs]
    return [list(dict.fromkeys(row.device for row in drivers)), [row.name for row in drivers],
            inputs + list(dict.fromkeys(commands)), [row.name for row in others], outputs]


def place_columns(columns: Sequence[Sequence[str]]) -> list[dict[str, Box]]:
    """Return label -> box for each column, all columns equally high."""
    height, left = float(max(map(len, columns))), 0.0
    boxes = []
    for labels, width in zip(columns, COLUMN_WIDTHS):
        step = height / len(labels)
        boxes.append({label: Box(left + 0.5 * width, height - (i + 0.5) * step, width,
                                 min(BOX_HEIGHT, 0.8 * step)) for i, label in enumerate(labels)})
        left += width + COLUMN_GAP
    return boxes


def draw_flow(ax: Axes, rows: Sequence[NodeRow]) -> None:
    """Draw devices, nodes and topics from left to right; feedback is dashed."""
    columns = columns_of(rows)
    boxes = place_columns(columns)
    devices, drivers, inputs, others, outputs = boxes
    top = float(max(map(len, columns)))
    for placed, kind, title in zip(boxes, COLUMN_KINDS, COLUMN_TITLES):
        for label, box in placed.items():
            draw_box(ax, box, label, COLORS[kind], rounded=kind != 'topic')
        ax.text(next(iter(placed.values())).x, top + 0.25, title, ha='center', fontsize=9,
                color='#666666')
    for row in rows:
        node = (drivers if row.device else others)[row.name]
        if row.device:
            join(ax, devices[row.device], node)
        for topic in row.publishes:
            join(ax, node, (inputs if row.device else outputs)[topic])
        for topic in row.subscribes:
            join(ax, inputs.get(topic) or outputs[topic], node)
    draw_offline(ax, [next(iter(placed.values())) for placed in boxes])
    right = next(iter(outputs.values()))
    ax.set(xlim=(-0.3, right.x + 0.5 * right.width + 0.3), ylim=(-1.4, top + 0.7))


def draw_offline(ax: Axes, columns: Sequence[Box]) -> None:
    """Draw what replaces devices and nodes: the simulator, and bags with the analysis."""
    labels = (('robot_simulator', 'emulates all devices\n(same bytes, on pseudo-terminals)'),
              ('ground_truth/*', 'exact values of the plant'),
              ('rosbag2 bag', 'all topics: record, replay, recover'),
              ('analyze, identify', 'the same estimators on bags;\ncalibration'),
              ('results', 'estimates as a bag, summary.json,\nfigures, parameter files'))
    boxes = [Box(box.x, -0.7, box.width + 0.45, 0.9) for box in columns]
    for box, (label, note), color in zip(boxes, labels, ('node', 'topic', 'topic', 'node',
                                                         'topic')):
        draw_box(ax, box, label, COLORS[color], note=note, rounded=color == 'node')
    for tail, head in zip(boxes, boxes[1:]):
        draw_arrow(ax, (tail.x + 0.5 * tail.width, tail.y), (head.x - 0.5 * head.width, head.y))


def join(ax: Axes, tail: Box, head: Box) -> None:
    """Draw the arrow of a message; one from right to left is feedback, and dashed."""
    if tail.x < head.x:
        draw_arrow(ax, (tail.x + 0.5 * tail.width, tail.y), (head.x - 0.5 * head.width, head.y))
    else:
        draw_arrow(ax, (tail.x - 0.5 * tail.width, tail.y - 0.2 * tail.height),
                   (head.x + 0.5 * head.width, head.y - 0.2 * head.height), color='#b45f06',
                   dashed=True)


def contents(room: str) -> str:
    """Return the folders in a room, '' where there are none."""
    folder = PACKAGE / room
    return ' '.join(sorted(path.parent.name for path in folder.glob('*/__init__.py')))


def crossed(tail: Spot, head: Spot, spots: Iterable[Spot]) -> int:
    """Return over how many other rooms the arrow from ``tail`` to ``head`` runs."""
    return sum(tail[1] > y > head[1]
               and abs(tail[0] + (head[0] - tail[0]) * (tail[1] - y) / (tail[1] - head[1]) - x)
               < CLEARANCE for x, y in spots)


def cost(places: Mapping[str, Spot], edges: Edges) -> float:
    """Return how hard a placement of the rooms is to read: arrows over rooms, long arrows."""
    total = 0.0
    for room, others in edges.items():
        for other in others:
            tail, head = places[room], places[other]
            total += 10.0 * crossed(tail, head, places.values()) + abs(tail[0] - head[0])
    return total + CENTERING * sum(abs(x - 0.5 * (COLUMNS - 1)) for x, _ in places.values())


def place_rooms(levels: Mapping[str, int], edges: Edges) -> dict[str, Spot]:
    """Return room -> (column, level), level by level the cheapest order until none is better."""
    rows: dict[int, list[str]] = {}
    for room in edges:
        rows.setdefault(levels[room], []).append(room)
    places = {room: (i + 0.5 * (COLUMNS - len(row)), float(level))
              for level, row in rows.items() for i, room in enumerate(row)}
    best = math.inf
    while (now := cost(places, edges)) < best:
        best = now
        for level, row in sorted(rows.items()):
            trials = [{**places, **{room: (float(column), float(level))
                                    for room, column in zip(row, order)}}
                      for order in permutations(range(COLUMNS), len(row))]
            places = min([places, *trials], key=lambda trial: cost(trial, edges))
    return places


def draw_rooms(ax: Axes, levels: Mapping[str, int], imports: Edges) -> None:
    """Draw the rooms by level, and the imports that no longer path implies."""
    base = [room for room in levels if levels[room] == 0 and room in imports]
    edges = {room: {other for other in others if levels[other] > 0}
             for room, others in reduced(imports).items() if levels[room] > 0}
    places = place_rooms(levels, edges)
    for room, (x, y) in places.items():
        draw_box(ax, Box(x, y, *ROOM_SIZE), room, COLORS['room'], note=contents(room))
        for other in sorted(edges[room]):
            head = places[other]
            if head[1] == y:  # an exception, below the rooms between them
                below = y - 0.5 * ROOM_SIZE[1]
                draw_arrow(ax, (x, below), (head[0], below), bend=SAME_LEVEL_BEND)
                continue
            shift = max(-0.3, min(0.3, 0.15 * (head[0] - x)))
            draw_arrow(ax, (x + shift, y - 0.5 * ROOM_SIZE[1]),
                       (head[0] - shift, head[1] + 0.5 * ROOM_SIZE[1]))
    middle = 0.5 * (COLUMNS - 1)
    draw_box(ax, Box(middle, 0.0, COLUMNS - 0.2, ROOM_SIZE[1]), '   '.join(base), COLORS['room'],
             note='arrows to this level are not drawn')
    for level in range(max(levels.values()) + 1):
        ax.text(-0.65, level, str(level), ha='center', va='center', fontsize=10, color='#666666')
    ax.set(xlim=(-0.8, COLUMNS - 0.4), ylim=(-0.45, max(levels.values()) + 0.45))


def draw(output: Path) -> None:
    """Write the figure to ``output``."""
    text = DOCUMENT.read_text(encoding='utf-8')
    levels, rows, imports = read_levels(text), read_nodes(text), read_imports()
    check_rooms(levels, imports)
    check_nodes(rows)
    matplotlib.use('agg')
    with plt.rc_context({'svg.fonttype': 'none', 'svg.hashsalt': 'smart_tire',
                         'font.family': 'sans-serif', 'font.sans-serif': FONTS}):
        figure, (flow, rooms) = plt.subplots(
            2, 1, figsize=FIGURE_SIZE, layout='constrained', height_ratios=PANEL_RATIO)
        draw_flow(flow, [row for row in rows if row.subscribes or row.device])
        draw_rooms(rooms, levels, imports)
        flow.set_title('Data flow: nodes and topics (dashed: feedback)', fontsize=11, loc='left')
        rooms.set_title('Rooms by level: an arrow is an import; those that a longer path '
                        'implies are left out', fontsize=11, loc='left')
        for ax in (flow, rooms):
            ax.axis('off')
        metadata = {'Date': None} if output.suffix == '.svg' else None
        figure.savefig(output, metadata=metadata, dpi=110)
        plt.close(figure)


if __name__ == '__main__':
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / 'docs' / 'architecture.svg')
