# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Live topics in the viewer, from publishers in the graph to the file of the recording."""

from __future__ import annotations

from importlib.util import find_spec
import signal

import pytest
from rclpy.qos import QoSProfile

from smart_tire.messages import TOPICS
from smart_tire.nodes.compat import message_class
from smart_tire.nodes.observer import Listener
from smart_tire.samples import Icr
from support.waiting import PATIENCE

pytestmark = [pytest.mark.processes, pytest.mark.skipif(
    find_spec('rerun') is None, reason='rerun is not installed')]


def test_live_topics_and_diagnostics_are_recorded_until_a_signal(
        isolated_ros, tmp_path, monkeypatch, capfd):
    from smart_tire.cli.view import LiveFeed
    from smart_tire.cli.main import main
    from support.rerun_file import RerunFile
    topic, publishers, flushes, statuses = TOPICS['icr'], [], [], []
    flush, on_status = LiveFeed.flush, LiveFeed.on_status

    class Publishing(Listener):
        """The listener publishes what it receives itself."""

        def start(self):
            publishers.append(self.create_publisher(
                message_class(topic.type), 'icr', QoSProfile(depth=10)))

    def flush_and_publish(feed):
        flush(feed)
        flushes.append(feed.samples)
        publishers[0].publish(topic.to_msg(
            message_class(topic.type)(), Icr(10_000_000 * len(flushes), 0.5, -2.0)))
        if feed.samples > 3 and statuses or len(flushes) > 10.0 * PATIENCE:
            signal.raise_signal(signal.SIGINT)

    def keep_status(feed, status):
        statuses.append(status)
        on_status(feed, status)

    monkeypatch.setattr('smart_tire.nodes.observer.Listener', Publishing)
    monkeypatch.setattr(LiveFeed, 'on_status', keep_status)
    monkeypatch.setattr(LiveFeed, 'flush', flush_and_publish)
    monkeypatch.setattr('sys.argv', ['smart_tire'])
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        file = tmp_path / 'live.rrd'
        assert main(['view', '--live', '--save', str(file)]) == 0
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    found = RerunFile(file)
    assert {value for _, (value,) in found.scalars('body/icr/y')} == {-2.0}
    assert found.scalars('links/total/frames_bad')
    assert all(value > 0.0 for _, (value,) in found.scalars('links/delay'))
    assert 'from reception until sent to the viewer: median ' in capfd.readouterr().out
