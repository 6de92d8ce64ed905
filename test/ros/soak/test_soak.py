"""The soak: what is chance follows from the seed, how is counted, and a run that finds a planted fault."""
import random
import re
import subprocess
import sys

import pytest
from node_bench import CHECKOUT
from rclpy.serialization import serialize_message

from svdm_ros.node.parameter_set import NodeParameters
from svdm_ros.soak.__main__ import main
from svdm_ros.soak.good_pairs import (
    frame_id,
    hostile_calibrations_come,
    may_have_other_calibration,
    parse_frame_id,
)
from svdm_ros.soak.hostile_messages import MAKERS, hostile_bytes
from svdm_ros.soak.requests import KERNELS, outcome, request
from svdm_ros.soak.tally import COLUMNS, Minute, Tally, rows, verdict


def hostile(seed):
    """Messages, and how long their bytes are: those between the fields are whatever memory held."""
    chance = random.Random(seed)
    messages = [maker(chance) for maker in MAKERS.values() for _ in range(50)]
    assert all(map(serialize_message, messages))
    return [*map(repr, messages), *(len(hostile_bytes(chance, message)) for message in messages)]


def test_hostile_messages_can_be_sent_and_follow_from_the_seed():
    assert hostile(1) == hostile(1) != hostile(2)


def test_requests_follow_from_the_seed_and_half_of_them_are_as_they_should_be():
    def taken(seed):
        chance, current = random.Random(seed), NodeParameters()
        return [outcome(current, request(chance)) for _ in range(300)]

    assert taken(1) == taken(1) != taken(2)
    assert 0.2 < sum(after is not None for after in taken(1)) / 300 < 0.8


def test_no_request_leads_to_other_kernels():
    chance, current, asked = random.Random(7), NodeParameters(), set()
    for _ in range(3000):
        changes = request(chance)
        asked |= changes.keys()
        current = outcome(current, changes) or current
    assert asked >= KERNELS and {name: current.value(name) for name in KERNELS} == {
        name: NodeParameters().value(name) for name in KERNELS}


@pytest.mark.parametrize('changes', [{'alhpa': 1.0}, {'alpha': float('nan')}, {'alpha': 2.0, 'w_p': 10}])
def test_a_request_that_must_be_refused(changes):
    assert outcome(NodeParameters(), changes) is None


def test_an_answer_is_known_by_its_frame_id():
    assert parse_frame_id(frame_id(5, 2, 10**18)) == (5, 2, 10**18)
    assert [parse_frame_id(text) for text in ('', 'camera', 'good 1 2', 'good 1 2 x', 'bad 1 2 3')] == [None] * 5


@pytest.mark.parametrize(('second', 'wrong', 'may'), [
    (3, ['f', 't', 'image.data'], True), (11, ['f'], True), (13, ['f', 't'], False), (3, ['image.data'], False),
    (3, ['f', 'delta_d'], False), (3, [], False),
])
def test_only_where_hostile_calibrations_come_may_an_answer_have_another(second, wrong, may):
    assert may_have_other_calibration((400 + second) * 10**9, wrong) is may
    assert hostile_calibrations_come((400 + second) * 10**9) is (second < 10)


def well():
    tally = Tally(minutes=[Minute(sent=10, answered=9, compared=8, latencies=[10.0] * 9, rss=[100])] * 2)
    tally.samples = [(float(second), 200_000_000 + 1000 * second) for second in range(300)]
    return tally


def test_the_table_has_each_minute_and_their_sum():
    table = [dict(zip(COLUMNS, row, strict=True)) for row in rows(well())]
    assert [row['minute'] for row in table] == ['1', '2', 'all']
    assert [row['answered'] for row in table] == ['9', '9', '18'] and table[0]['p99 (ms)'] == '10'


def test_the_verdict():
    tally = well()
    assert tally.is_well
    assert verdict(tally) == ('deaths 0, wrong 0 of 16 compared, faults 0, RSS +3.6 MB an hour after the first third')
    tally.fault('half-applied', 'alpha')
    assert not tally.is_well
    many = well()
    many.minutes[0].other_calibration = 1
    assert not many.is_well
    assert not Tally().is_well  # nothing was compared


@pytest.mark.parametrize(('name', 'value'), [('--minutes', '0'), ('--size', '64x480')])
def test_a_wrong_argument_is_named(name, value, capsys):
    with pytest.raises(SystemExit) as end:
        main([name, value])
    assert end.value.code == 2 and f"'{value}' is not allowed" in capsys.readouterr().err


PLANTED = """
import sys
from svdm_ros.soak import run
from svdm_ros.soak.__main__ import main

run._CALM, run._STOPPED, run._VARIATIONS = 1.5, 0.3, ({},)
right = run.expected_answers
def planted(*given):
    answers = right(*given)
    answers[0].image.data[5000] ^= 1
    return answers
run.expected_answers = planted
sys.exit(main(['--minutes', '0.01', '--requests', '20', '--seed', '3']))
"""


@pytest.mark.slow
def test_a_short_run_finds_a_planted_fault_and_no_other():
    run = subprocess.run([sys.executable, '-c', PLANTED], cwd=CHECKOUT, capture_output=True, text=True, timeout=100)
    assert run.returncode == 1, run.stderr
    kinds = [line for line in run.stderr.splitlines() if line.startswith('soak: ')]
    assert len(kinds) == 1 and kinds[0].startswith('soak: another answer than offline')
    assert 'image.data of pair' in run.stderr
    wrong, compared = map(int, re.search(r'wrong (\d+) of (\d+) compared', run.stdout).groups())
    assert 0 < wrong < compared / 2
