"""What the recorder asks of publishers."""

from __future__ import annotations

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from smart_tire.nodes.recorder import adapted, offered, weaker

RELIABLE = QoSProfile(depth=5)
BEST_EFFORT = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def test_it_asks_for_the_most_that_all_offer():
    assert adapted('/a', [RELIABLE]).reliability == ReliabilityPolicy.RELIABLE
    assert adapted('/a', [RELIABLE]).durability == DurabilityPolicy.VOLATILE
    assert adapted('/a', [LATCHED, LATCHED]).durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert adapted('/a', [LATCHED, RELIABLE]).durability == DurabilityPolicy.VOLATILE
    assert adapted('/a', [RELIABLE, BEST_EFFORT]).reliability == ReliabilityPolicy.BEST_EFFORT


@pytest.mark.parametrize('name', ['/tire_samples', '/field/robot/tire_samples'])
def test_it_keeps_two_seconds_of_all_wheels_at_five_times_their_rate(name):
    assert adapted(name, [RELIABLE]).depth == 4 * 4000


@pytest.mark.parametrize(('had', 'needs', 'new'), [
    ([RELIABLE], [RELIABLE, RELIABLE], False),
    ([RELIABLE], [RELIABLE, BEST_EFFORT], True),
    ([LATCHED], [LATCHED, RELIABLE], True),
    ([RELIABLE, BEST_EFFORT], [RELIABLE], False),
    ([BEST_EFFORT], [BEST_EFFORT, BEST_EFFORT], False)])
def test_it_subscribes_anew_only_for_a_publisher_that_offers_less(had, needs, new):
    assert weaker(adapted('/a', needs), adapted('/a', had)) is new


def test_the_bag_tells_what_was_offered():
    assert offered(LATCHED).durability == 'transient_local'
    assert offered(BEST_EFFORT).reliability == 'best_effort'
    assert (offered(RELIABLE).reliability, offered(RELIABLE).durability) == (
        'reliable', 'volatile')
