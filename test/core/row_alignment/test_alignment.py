"""RowAlignment: the field, the resampling against a naive oracle, and its files."""
import math

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from scenes import noise

from svdm_core import RowAlignment

FIELD = (0.3, -0.2, 0.4, 1.1, 0.1, -0.2)
NUMBERS = st.floats(-100, 100)


def cubic(distance):
    """OpenCV's kernel, a = -0.75 (Keys 1981)."""
    a, d = -0.75, abs(distance)
    if d <= 1:
        return (a + 2) * d**3 - (a + 3) * d**2 + 1
    return a * (d**3 - 5 * d**2 + 8 * d - 4) if d < 2 else 0.0


def resampled(image, rows):
    """Pixel by pixel from the equation."""
    height, width = image.shape[:2]
    out = np.zeros(image.shape)
    for y in range(height):
        for x in range(width):
            at = y + rows.offsets(x, y)
            first = math.floor(at) - 1
            for row in range(first, first + 4):
                out[y, x] += cubic(at - row) * image[min(max(row, 0), height - 1), x].astype(float)
    return out


def test_the_field_by_hand():
    rows = RowAlignment((1, 2, 3, 4, 5, 6), 200, 100)
    assert rows.offsets(100, 50) == 1 and rows.offsets(0, 0) == 1 - 2 - 3 + 4 + 5 + 6
    assert rows.offsets(150, 25) == 1 + 2 * 0.5 - 3 * 0.5 - 4 * 0.25 + 5 * 0.25 + 6 * 0.25
    assert rows.offsets(np.zeros((1, 7)), np.zeros((5, 1))).shape == (5, 7)


@pytest.mark.parametrize('dtype', [np.uint8, np.uint16])
@pytest.mark.parametrize('shape', [(23, 31), (23, 31, 3), (1, 1), (1, 9, 3), (9, 1), (2, 3)])
def test_it_resamples_as_the_equation_says(shape, dtype):
    image = cv2.blur(noise(64, 64, 3, dtype=dtype), (3, 3))[:shape[0], :shape[1]].copy()
    image = image if len(shape) == 3 else image[:, :, 0].copy()
    rows = RowAlignment(FIELD, shape[1], shape[0])
    before = image.copy()
    found = rows.apply(image)
    largest = np.iinfo(dtype).max
    assert found.dtype == dtype and found.shape == shape and found is not image
    bound = 0.02 * largest  # OpenCV may round places to 1/32 px
    np.testing.assert_allclose(found, np.clip(resampled(image, rows), 0, largest), atol=bound)
    np.testing.assert_array_equal(image, before)
    np.testing.assert_array_equal(rows.apply(image), found)


def test_whole_rows_are_moved_to_the_bit_and_the_identity_copies():
    image = noise(40, 30)
    moved = RowAlignment((2, 0, 0, 0, 0, 0), 30, 40).apply(image)
    np.testing.assert_array_equal(moved[:-2], image[2:])
    np.testing.assert_array_equal(moved[-2:], image[[-1, -1]])
    same = RowAlignment.identity(30, 40).apply(image)
    assert same is not image and not np.shares_memory(same, image)
    np.testing.assert_array_equal(same, image)


@pytest.mark.parametrize('view', [lambda image: image[::2, ::2], lambda image: image[:, ::-1], np.asfortranarray])
def test_any_strides_and_read_only_images(view):
    image = view(noise(40, 60))
    image.flags.writeable = False
    rows = RowAlignment(FIELD, image.shape[1], image.shape[0])
    np.testing.assert_array_equal(rows.apply(image), rows.apply(image.copy()))


@pytest.mark.parametrize(('image', 'words'), [
    (noise(40, 31), 'images of 31 x 40 px cannot be aligned by a row alignment for 30 x 40 px'),
    (noise(40, 30, 4), r'shape (40, 30, 4) is not allowed'), (noise(40), r'shape (40,) is not allowed'),
    (np.zeros((40, 30)), 'dtype float64 is not allowed'), ([1], 'list is not allowed')])
def test_an_image_of_another_size_or_kind_is_refused_in_one_line(image, words):
    with pytest.raises(ValueError) as refused:
        RowAlignment(FIELD, 30, 40).apply(image)
    assert words in str(refused.value) and '\n' not in str(refused.value)


@pytest.mark.parametrize(('changes', 'words'), [
    ({'coefficients': (1, 2, 3)}, 'coefficients = (1, 2, 3) is not allowed: it must be 6 finite numbers'),
    ({'coefficients': (1, 2, 3, 4, 5, math.nan)}, 'coefficients: nan is not allowed'),
    ({'coefficients': (1, 2, 3, 4, 5, 101)}, 'coefficients: 101 is not allowed'),
    ({'coefficients': (1, 2, 3, 4, 5, '6')}, "coefficients: '6' is not allowed"),
    ({'coefficients': 'abcdef'}, "coefficients = 'abcdef' is not allowed"),
    ({'width': 0}, 'width = 0 is not allowed'), ({'height': 32767}, 'it must be an integer, 1 to 32766'),
    ({'height': 2.5}, 'height = 2.5 is not allowed'),
    ({'points': -1}, 'points = -1 is not allowed'), ({'width': True}, 'width = True is not allowed'),
    ({'residual_after': math.inf}, 'residual_after = inf is not allowed'),
    ({'residual_before': -1}, 'residual_before = -1 is not allowed')])
def test_values_that_make_no_sense_are_refused(changes, words):
    with pytest.raises(ValueError) as refused:
        RowAlignment(**{'coefficients': FIELD, 'width': 30, 'height': 40, **changes})
    assert words in str(refused.value)


@given(st.tuples(*[NUMBERS] * 6), st.integers(1, 32766), st.integers(1, 32766), st.floats(0, 1e3))
def test_a_file_holds_all_of_it(tmp_path_factory, coefficients, width, height, residual):
    path = tmp_path_factory.mktemp('rows') / 'rows.yaml'
    rows = RowAlignment(coefficients, width, height, 77, residual, residual / 3)
    rows.save(path)
    assert RowAlignment.load(path) == rows and hash(RowAlignment.load(path)) == hash(rows)


def test_nothing_is_overwritten_unasked(tmp_path):
    rows = RowAlignment(FIELD, 30, 40)
    rows.save(tmp_path / 'a.yaml')
    with pytest.raises(ValueError, match=r'a\.yaml exists already'):
        RowAlignment.identity(3, 4).save(tmp_path / 'a.yaml')
    assert RowAlignment.load(tmp_path / 'a.yaml') == rows
    RowAlignment.identity(3, 4).save(tmp_path / 'a.yaml', force=True)
    assert RowAlignment.load(tmp_path / 'a.yaml') == RowAlignment.identity(3, 4)


def spoilt(**changes):
    values = {**RowAlignment(FIELD, 30, 40, 100, 0.5, 0.1).as_dict(), **changes}
    return yaml.safe_dump({'row_alignment': {name: value for name, value in values.items() if value is not None}})


@pytest.mark.parametrize(('text', 'words'), [
    ('', "no row alignment: expected 'row_alignment:' and below it coefficients, width"),
    ('- 1', 'no row alignment'), ('row_alignment: 3', 'no row alignment'), ('{', 'no YAML'),
    (spoilt(width=None), 'width is missing'), (spoilt(wide=3), "'wide' is not known: there are coefficients, width"),
    (spoilt(coefficients=[1, 2, 3, 4, 5, math.inf]), 'coefficients: inf is not allowed'),
    (spoilt(coefficients=[1, 2, 3, 4, 5, math.nan]), 'coefficients: nan is not allowed'),
    (spoilt(coefficients=[1, 2, 3]), 'it must be 6 finite numbers of px'), (spoilt(height=-3), 'height = -3'),
    (spoilt(points='many'), "points = 'many' is not allowed"), ('a: &a [*a, *a]', 'anchor or alias')])
def test_a_bad_file_is_one_line_with_its_name(tmp_path, text, words):
    path = tmp_path / 'bad.yaml'
    path.write_text(text)
    with pytest.raises(ValueError) as refused:
        RowAlignment.load(path)
    told = str(refused.value)
    assert told.startswith(f'{path}: ') and words in told and '\n' not in told


def test_a_file_that_is_not_there_is_told(tmp_path):
    with pytest.raises(ValueError, match='there is no such file'):
        RowAlignment.load(tmp_path / 'none.yaml')
    with pytest.raises(ValueError, match='is a folder'):
        RowAlignment.load(tmp_path)


def test_it_is_equal_whatever_it_has_done():
    one, another = (RowAlignment(FIELD, 30, 40) for _ in range(2))
    one.apply(noise(40, 30))
    assert one == another and hash(one) == hash(another) and 'map' not in repr(one)
    assert one != RowAlignment(FIELD, 30, 41)
    with pytest.raises(AttributeError):
        one.width = 3
