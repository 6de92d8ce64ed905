"""What lasts is told with what to do, and nothing is told of what is well."""
import random

import pytest

from svdm_ros.node.shortfalls import Counts, FailedMatches, FallingBehind, LostImages

MS = 1_000_000
TOPICS = {'left': '/l', 'right': '/r'}


def run_camera(seconds, left, right=None, tolerance_ns=0, topics=TOPICS):
    """LostImages after `seconds` of a camera of 20 Hz; left, right: second, stamp (ns) -> its stamp, or None: lost."""
    lost, counts, texts = LostImages(topics), [0, 0, 0], []
    for second in range(seconds):
        for frame in range(20):
            stamp = 10**18 + (20 * second + frame) * 50 * MS
            stamps = {'left': left(second, stamp), 'right': (right or left)(second, stamp)}
            came = {side: value for side, value in stamps.items() if value is not None and side in topics}
            for side, value in came.items():
                lost.add(side, value)
            counts[0] += 'left' in came
            counts[1] += 'right' in came
            counts[2] += len(came) == 2 and abs(came['left'] - came['right']) <= tolerance_ns
        found = lost.check(Counts(*counts, 0), tolerance_ns)
        texts.append([shortfall.line.text for shortfall in found if shortfall.line.text])
    return texts


def losing(share, seed=0, until=10**9):
    chance = random.Random(seed)
    return lambda second, stamp: stamp if second >= until or chance.random() >= share else None


def all_of_them(second, stamp):
    return stamp


def test_all_is_well():
    assert run_camera(30, all_of_them) == [[]] * 30


@pytest.mark.parametrize('share', [0.5, 0.8])
def test_lost_images_are_told_with_the_topic_and_what_to_do(share):
    texts = run_camera(60, losing(share), losing(share, seed=1))[-1]
    assert len(texts) == 2
    assert '/l: ' in texts[0] and '/r: ' in texts[1]
    assert float(texts[0].split()[1].rstrip('%')) == pytest.approx(100 * share, abs=20)
    assert 'config/fastdds.xml' in texts[0]
    assert '-p qos_overrides./l.subscription.reliability:=reliable' in texts[0]


def test_one_side_that_loses_images_is_told_alone():
    texts = run_camera(30, all_of_them, losing(0.4))[-1]
    assert len(texts) == 1 and texts[0].startswith('/r: ')


def test_one_image_of_both_views_has_one_topic():
    texts = run_camera(30, losing(0.5), topics={'left': '/both'})[-1]
    assert len(texts) == 1 and texts[0].startswith('/both: ')


def test_a_few_lost_images_are_no_alarm_and_the_end_of_a_loss_is_seen():
    assert not any(run_camera(60, losing(0.05)))
    assert run_camera(60, losing(0.5, until=30))[-1] == []


def test_jitter_beyond_the_tolerance_is_told_with_a_tolerance():
    chance = random.Random(0)

    def jittering(second, stamp):
        return stamp + chance.randint(0, 8) * MS

    texts = run_camera(30, all_of_them, jittering, tolerance_ns=2 * MS)[-1]
    assert len(texts) == 1
    assert 'found their partner: their stamps are up to 0.00' in texts[0]
    assert 'set approximate_sync_tolerance to 0.01' in texts[0]


def behind(share, counting=True, seconds=30):
    falling = FallingBehind()
    totals = [Counts(30 * second, 30 * second, 30 * second, round(30 * second * share)) for second in range(seconds)]
    return [falling.check(counts, 89.0, counting).line.text for counts in totals]


def test_a_node_that_falls_behind_is_told_what_to_turn():
    texts = behind(0.68)
    assert texts[15] == '' and texts[-1].startswith('the node falls behind: 408 of 600 pairs in 20 s')
    assert 'takes 89 ms: use preset fast, downscale or roi, or set max_rate' in texts[-1]


@pytest.mark.parametrize(('share', 'counting'), [(0.05, True), (0.9, False)])
def test_a_node_that_keeps_up_or_is_to_leave_some_out_is_not_behind(share, counting):
    assert not any(behind(share, counting))


def test_a_low_share_is_told_once_there_are_enough_pairs():
    assert FailedMatches().check([0.3] * 29, 1.0).line.text == ''
    text = FailedMatches().check([0.3] * 30, 1.0).line.text
    assert text.startswith('only 30% of the pixels are valid') and 'swapped' in text


@pytest.mark.parametrize(('shares', 'tau_lr'), [([0.6] * 30, 1.0), ([0.9] * 20 + [0.1] * 10, 1.0), ([0.2] * 30, 0.5)])
def test_usual_shares_single_bad_pairs_and_a_strict_check_are_no_alarm(shares, tau_lr):
    assert FailedMatches().check(shares, tau_lr).line.text == ''
