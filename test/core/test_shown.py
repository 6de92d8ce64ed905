"""Text from outside in messages: printable, one line, short, and still told apart."""
from hypothesis import given
from hypothesis import strategies as st

from svdm_core.shown import cut, line, nearest, shown

ANY_TEXT = st.text(st.characters(), max_size=500)  # surrogates too
SUFFIX = len('... (100000 characters)')


@given(ANY_TEXT, st.sampled_from([1, 1000]), st.sampled_from([100, 200]))
def test_whatever_the_text_it_is_printable_and_short(text, times, longest):
    for told in (shown(text * times, longest), cut(text * times, longest), line(text * times)[:longest]):
        assert told.isprintable()
        assert len(told) <= longest + 2 + SUFFIX


@given(st.text(max_size=50).filter(str.isprintable))
def test_what_is_short_and_printable_is_shown_as_it_is(text):
    assert shown(text) == repr(text)
    assert line(f'  {text}') == f'  {text}'
    assert cut(text) == ' '.join(text.split())


def test_what_a_terminal_obeys_is_spelt_out():
    assert shown('a\n\x1b[2J\u202e') == r"'a\n\x1b[2J\u202e'"
    assert line('a\n\x1b[2J\u202e') == r'a \x1b[2J\u202e'
    assert line('x' * 5000) == 'x' * 2000 + '... (5000 characters)'
    assert shown('x' * 201) == repr('x' * 200) + '... (201 characters)'


def test_values_of_any_kind_are_shown():
    assert shown(10**5000) == 'one of type int, too long to write'
    assert shown([1, 2]) == '[1, 2]'
    assert len(shown(list(range(10**4)))) < 250


def test_the_nearest_name():
    assert nearest('alhpa', ['beta', 'alpha']) == 'alpha'
    assert nearest('q', ['beta', 'alpha']) == nearest('alpha' * 10**6, ['alpha']) == ''
