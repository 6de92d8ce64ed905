"""Pairing by stamp: which pairs come out, in which order, and what survives loops, losses and disorder."""
import itertools

from hypothesis import given
from hypothesis import strategies as st

from svdm_ros.frames.stereo_pairing import JUMP_BACK_NS, Pair, StereoPairer

MS = 1_000_000
PERIOD = 33 * MS
SIDES = st.sampled_from(['left', 'right'])
STREAM = st.lists(st.tuples(SIDES, st.integers(0, 60).map(lambda tick: tick * 7 * MS)), max_size=80)


def feed(pairer, images):
    """Send (side, stamp) in order, the image being its stamp; all pairs that come out."""
    return [pair for side, stamp in images for pair in pairer.add(side, stamp, stamp)]


def interleaved(stamps, right_offset=0):
    return [image for stamp in stamps for image in (('left', stamp), ('right', stamp + right_offset))]


def test_equal_stamps_pair_at_once():
    pairer = StereoPairer()
    assert pairer.add('left', 5, 'L') == []
    assert pairer.add('right', 5, 'R') == [Pair('L', 'R', 0)]
    assert pairer.waiting == {'left': 0, 'right': 0}


def test_a_nanosecond_apart_is_no_exact_pair():
    assert feed(StereoPairer(), interleaved([0, PERIOD, 2 * PERIOD], right_offset=1)) == []


@given(st.integers(0, 30), st.integers(-16, 16))
def test_a_constant_offset_within_the_tolerance_pairs_every_frame_at_once(count, offset_ms):
    pairer = StereoPairer(tolerance_ns=16 * MS)
    for index in range(1, count + 1):
        pairs = feed(pairer, interleaved([index * PERIOD], right_offset=offset_ms * MS))
        assert [(pair.left, pair.right) for pair in pairs] == [(index * PERIOD, index * PERIOD + offset_ms * MS)]


@given(STREAM, st.integers(0, 100), st.integers(1, 12))
def test_pairs_are_near_in_order_used_once_and_the_queue_is_bounded(stream, tolerance_ms, queue_size):
    pairer = StereoPairer(tolerance_ms * MS, queue_size)
    pairs = []
    for number, (side, stamp) in enumerate(stream):
        jumps = pairer.jumps
        new = pairer.add(side, stamp, (number, stamp))
        if pairer.jumps != jumps:  # with the jump come the pairs from before it; those of after hold what jumped
            of_after = [pair for pair in new if number in (pair.left[0], pair.right[0])]
            new = [*(pair for pair in new if pair not in of_after), None, *of_after]
        pairs += new
        assert max(pairer.waiting.values()) <= queue_size
    made = [pair for pair in pairs if pair]
    assert all(abs(pair.left[1] - pair.right[1]) == pair.gap_ns <= tolerance_ms * MS for pair in made)
    for side in ('left', 'right'):
        used = [getattr(pair, side) for pair in made]
        assert len(set(used)) == len(used)
    for earlier, later in itertools.pairwise(pairs):
        if earlier and later:
            assert earlier.left[1] <= later.left[1] and earlier.right[1] <= later.right[1]


@given(STREAM, st.integers(0, 100), st.integers(1, 12))
def test_every_image_is_paired_waiting_or_counted_as_unpaired(stream, tolerance_ms, queue_size):
    pairer = StereoPairer(tolerance_ms * MS, queue_size)
    pairs = feed(pairer, stream)
    for side in ('left', 'right'):
        sent = sum(1 for name, _ in stream if name == side)
        assert sent == len(pairs) + pairer.waiting[side] + pairer.unpaired[side]


@given(st.sets(st.integers(0, 40)), st.sets(st.integers(0, 40)), st.integers(0, 5), st.randoms())
def test_exact_pairing_finds_every_common_stamp_however_the_two_sides_interleave(left, right, lag, random):
    sent = sorted(
        [(stamp + random.randint(0, lag), 'left', stamp) for stamp in left]
        + [(stamp + random.randint(0, lag), 'right', stamp) for stamp in right]
    )
    images = []
    for side in ('left', 'right'):  # a topic keeps its order, the two topics run ahead of each other
        own = sorted(stamp for _, name, stamp in sent if name == side)
        images.append(iter(own))
    queues = dict(zip(('left', 'right'), images, strict=True))
    stream = [(name, next(queues[name]) * PERIOD) for _, name, _ in sent]
    pairs = feed(StereoPairer(queue_size=100), stream)
    assert [pair.left for pair in pairs] == [stamp * PERIOD for stamp in sorted(left & right)]


@given(st.lists(st.integers(-15, 15), min_size=2, max_size=20))
def test_with_jitter_the_pairs_are_the_nearest_ones(jitter_ms):
    stamps = [(index * PERIOD, index * PERIOD + jitter * MS) for index, jitter in enumerate(jitter_ms)]
    pairs = feed(StereoPairer(tolerance_ns=30 * MS), [i for a, b in stamps for i in (('left', a), ('right', b))])
    assert all((pair.left, pair.right) in stamps for pair in pairs)
    assert len(pairs) >= len(stamps) - 1  # the last may wait for a nearer partner


def test_a_lost_image_does_not_shift_the_pairs_under_a_generous_tolerance():
    pairer = StereoPairer(tolerance_ns=100 * MS)
    stamps = [index * PERIOD for index in range(12)]
    images = [image for image in interleaved(stamps) if image != ('left', stamps[5])]
    pairs = feed(pairer, images)
    assert [(pair.left, pair.right) for pair in pairs] == [(s, s) for s in stamps if s != stamps[5]]


def test_of_two_candidates_the_nearer_is_taken():
    pairer = StereoPairer(tolerance_ns=20 * MS)
    pairs = feed(pairer, [('right', 0), ('right', 30 * MS), ('left', 18 * MS)])
    assert [(pair.left, pair.right) for pair in pairs] == [(18 * MS, 30 * MS)]


def test_an_image_waits_no_longer_for_a_partner_that_is_nearer_to_a_later_one():
    pairer = StereoPairer(tolerance_ns=20 * MS)
    pairs = feed(pairer, [('left', 0), ('left', 12 * MS), ('right', 14 * MS), ('left', 24 * MS)])
    assert [(pair.left, pair.right) for pair in pairs] == [(12 * MS, 14 * MS)]


@given(st.integers(1, 40), st.integers(1, 4), st.booleans())
def test_all_pairs_of_every_pass_of_a_looping_bag_come_out(frames, passes, right_first):
    stamps = [10**9 + index * PERIOD for index in range(frames)]
    stream = [image for _ in range(passes) for image in interleaved(stamps)]
    if right_first:
        stream = [image for left, right in zip(stream[::2], stream[1::2], strict=True) for image in (right, left)]
    pairer = StereoPairer()
    assert [pair.left for pair in feed(pairer, stream)] == stamps * passes


@given(st.integers(2, 12), st.integers(1, 8), st.integers(0, 3), st.integers(0, 3))
def test_a_loop_shorter_than_any_jump_gives_its_pairs_under_a_tolerance_too(frames, period_ms, left_ms, right_ms):
    stamps = [index * period_ms * 8 * MS for index in range(frames)]
    offsets = {'left': left_ms * MS, 'right': right_ms * MS}
    one_pass = [(side, stamp + offset) for stamp in stamps for side, offset in offsets.items()]
    pairer = StereoPairer(tolerance_ns=3 * MS)
    assert [pair.left - offsets['left'] for pair in feed(pairer, one_pass * 3)] == stamps * 3
    assert pairer.jumps == 2


def test_an_image_that_comes_late_in_the_second_pass_is_no_further_jump():
    stamps = [0, 20 * MS, 40 * MS]
    pairer = StereoPairer()
    pairs = feed(pairer, interleaved(stamps) + interleaved([0, 40 * MS, 20 * MS, 60 * MS]))
    assert pairer.jumps == 1
    assert [pair.left for pair in pairs] == [*stamps, 0, 40 * MS, 60 * MS]


def test_no_pair_is_lost_when_one_side_loops_before_the_other():
    stamps = [index * PERIOD for index in range(20)]
    stream = [*interleaved(stamps)[:-1], ('right', stamps[0]), ('left', stamps[-1])]
    stream += [('left', stamps[0]), *interleaved(stamps[1:])]
    pairs = feed(StereoPairer(), stream)
    assert [pair.left for pair in pairs] == stamps[:-1] + stamps


def test_a_loop_that_is_a_jump_on_one_side_only_gives_its_pairs():
    last = JUMP_BACK_NS
    bag = [('left', 0), ('right', 0), ('left', last // 2), ('right', last // 2), ('left', last), ('right', last + MS)]
    pairs = feed(StereoPairer(tolerance_ns=2 * MS), [*bag, ('right', 0), ('left', 0), *bag[2:]])
    assert [pair.left for pair in pairs] == [0, last // 2, last] * 2


def test_a_jump_drops_what_waits_and_says_so():
    pairer = StereoPairer()
    feed(pairer, [('left', 10**10), ('left', 10**10 + PERIOD), ('left', 0)])
    assert (pairer.jumps, pairer.waiting['left'], pairer.unpaired['left']) == (1, 1, 2)


@given(st.integers(1, JUMP_BACK_NS // MS))
def test_a_late_image_clears_nothing(late_ms):
    pairer = StereoPairer()
    feed(pairer, [('left', 10**9), ('left', 10**9 - late_ms * MS)])
    assert pairer.jumps == 0
    pairs = feed(pairer, [('right', 10**9 - late_ms * MS), ('right', 10**9)])
    assert [pair.left for pair in pairs] == [10**9 - late_ms * MS, 10**9]


def test_an_image_older_than_the_last_pair_is_dropped():
    pairer = StereoPairer(tolerance_ns=5 * MS)
    feed(pairer, [('left', 50 * MS), ('right', 50 * MS)])
    assert feed(pairer, [('left', 40 * MS), ('right', 40 * MS)]) == []
    assert pairer.unpaired == {'left': 1, 'right': 1}


def test_stamps_that_stand_still_are_paired_too():
    assert len(feed(StereoPairer(), interleaved([0] * 7))) == 7


def test_the_closest_gap_is_told_once():
    pairer = StereoPairer()
    feed(pairer, interleaved([0, 100 * MS], right_offset=5 * MS))
    assert pairer.take_closest_gap() == 5 * MS
    assert pairer.take_closest_gap() is None


def test_the_closest_gap_is_the_smallest_not_the_last():
    pairer = StereoPairer()
    feed(pairer, [('left', 0), ('right', 3 * MS), ('left', 200 * MS), ('right', 207 * MS)])
    assert pairer.take_closest_gap() == 3 * MS


def test_at_the_end_a_pair_that_might_have_found_nearer_partners_comes_out():
    pairer = StereoPairer(tolerance_ns=30 * MS)
    assert feed(pairer, [('left', 0), ('left', 33 * MS), ('right', 53 * MS)]) == []  # a left at 66 ms would be nearer
    assert pairer.flush() == [Pair(33 * MS, 53 * MS, 20 * MS)]
    assert pairer.flush() == []


@given(STREAM, st.integers(0, 100))
def test_after_the_end_every_image_is_paired_left_over_or_counted(stream, tolerance_ms):
    pairer = StereoPairer(tolerance_ms * MS, queue_size=100)
    pairs = feed(pairer, stream) + pairer.flush()
    for side in ('left', 'right'):
        sent = sum(1 for name, _ in stream if name == side)
        assert sent == len(pairs) + pairer.waiting[side] + pairer.unpaired[side]
    assert pairer.flush() == []


def test_a_pair_that_waits_when_time_jumps_back_is_not_lost():
    pairer = StereoPairer(tolerance_ns=30 * MS)
    once = [('left', 0), ('left', 33 * MS), ('right', 53 * MS)]
    later = [(side, stamp - 1000 * MS) for side, stamp in once]
    assert feed(pairer, once + later) == [Pair(33 * MS, 53 * MS, 20 * MS)]
    assert pairer.jumps == 1
    assert pairer.flush() == [Pair(-967 * MS, -947 * MS, 20 * MS)]


@given(STREAM, st.integers(0, 100), st.integers(1, 12), st.integers(1, 40))
def test_what_waits_is_bounded_in_bytes_but_for_the_newest(stream, tolerance_ms, queue_size, most):
    pairer = StereoPairer(tolerance_ms * MS, queue_size, most_bytes=most)
    pairs = []
    for side, stamp in stream:
        pairs += pairer.add(side, stamp, stamp, size=7)
        assert all(count <= max(1, most // 7) for count in pairer.waiting.values())
    for side in ('left', 'right'):
        sent = sum(1 for name, _ in stream if name == side)
        assert sent == len(pairs) + pairer.waiting[side] + pairer.unpaired[side] + pairer.beyond_memory[side]
