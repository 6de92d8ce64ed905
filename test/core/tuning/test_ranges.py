"""What to vary, as it is written on the command line and as the paper has it."""
import contextlib
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from svdm_core import load_preset, parameter_info
from svdm_core.commands.options import parse_changes
from svdm_core.evaluation.paper import PAPER_STUDY, PAPER_STUDY_START
from svdm_core.tuning.ranges import MAX_VALUES, paper_ranges, parse_range


@pytest.mark.parametrize(('text', 'values'), [
    ('alpha=10:11:0.1', tuple(round(10 + 0.1 * i, 1) for i in range(11))),
    ('sigma_c=0.170:0.180:0.001', tuple(round(0.17 + 0.001 * i, 3) for i in range(11))),
    ('w_p=5:1:-2', (5, 3, 1)),
    ('w_p=1:6:2', (1, 3, 5)),
    ('d_y=20:20:5', (20,)),
    ('w_p=11, 21,31', (11, 21, 31)),
    ('tau_ad=1e-3,0.1', (0.001, 0.1)),
    ('median_scope=filled,all', ('filled', 'all')),
    ('subpixel=true,false', (True, False)),
])
def test_a_range_is_read(text, values):
    entry = parse_range(text)
    assert entry.values == values and {type(value) for value in entry.values} == {type(values[0])}


@pytest.mark.parametrize(('text', 'words'), [
    ('alpha=10:11:0', 'never ends: a step of 0 does not lead from 10 to 11'),
    ('alpha=10:11:-0.1', 'never ends: a step of -0.1 does not lead'),
    ('alpha=11:10:0.1', 'never ends'),
    ('alpha=0:inf:1', 'is not a range'),
    ('alpha=0:nan:1', 'is not a range'),
    ('alpha=0:1000:0.0001', f'has more than {MAX_VALUES} values'),
    ('alpha=10:11', 'is not a range: write first:last:step'),
    ('alpha', "'alpha' is not a range: write it as"),
    ('alpha=', 'is not a range: write it as'),
    ('alpha=a:b:c', 'a, b, c are not three numbers'),
    ('alpha=1,x', "alpha = 'x' is not allowed: it must be a number"),
    ('alpha=nan', "alpha = 'nan' is not allowed"),
    ('alpha=1,1.0', 'has a value twice'),
    ('w_p=1:4:1', 'w_p = 2 is not allowed: it must be an integer, 1, 3 ... 101'),
    ('w_p=1:3:0.5', 'w_p = 1.5 is not allowed'),
    ('alpah=1:2:1', "unknown parameter 'alpah': did you mean alpha"),
    ('median_scope=a:b:c', 'is not a range: write the values as a,b'),
    ('median_scope=some', "median_scope = 'some' is not allowed: it must be filled | all"),
    ('num_disparities=16:64:16', 'num_disparities cannot be set here: each scene has its own'),
])
def test_a_wrong_range_is_refused_in_one_line(text, words):
    with pytest.raises(ValueError, match=re.escape(words)) as error:
        parse_range(text)
    assert '\n' not in str(error.value)


@given(st.integers(0, 9000), st.integers(0, 200), st.integers(1, 50), st.booleans())
def test_a_range_holds_each_step_exactly(first, count, step, downwards):
    """In hundredths, so that what is expected can be said without rounding."""
    hundredths = [first + step * i for i in range(count + 1)]
    if downwards:
        hundredths, step = hundredths[::-1], -step
    text = f'alpha={hundredths[0] / 100}:{hundredths[-1] / 100}:{step / 100}'
    assert parse_range(text).values == tuple(value / 100 for value in hundredths)


@given(st.text(max_size=30))
def test_any_other_text_is_refused_with_a_value_error(text):
    for parse in (parse_range, lambda text: parse_changes([text])):
        for arguments in (text, f'alpha={text}', f'w_p={text}', f'subpixel={text}'):
            with contextlib.suppress(ValueError):
                parse(arguments)


def test_the_papers_study_is_complete():
    assert [(table.number, table.parameter, len(table.values)) for table in PAPER_STUDY] == [
        (2, 'alpha', 11), (3, 'sigma_s', 11), (4, 'sigma_c', 11), (5, 'w_p', 20)]
    optimum, start = load_preset('paper'), load_preset('paper_start')
    for table, entry in zip(PAPER_STUDY, paper_ranges(), strict=True):
        assert len(table.nonocc) == len(table.everywhere) == len(table.values) == len(set(entry.values))
        assert table.chosen in table.values and getattr(optimum, table.parameter) == table.chosen
        assert getattr(start, table.parameter) == PAPER_STUDY_START[table.parameter]
        for value in entry.values:
            assert type(parameter_info(entry.name).check(value)) is type(value)
