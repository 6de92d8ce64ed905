"""Records of a .mcap file whose numbers do not fit."""
import io

import pytest

from svdm_ros.bags.reading.mcap_records import CHUNK, CutOffError, Record, content_of


@pytest.mark.parametrize('size', [-1, -9, 2**40])
def test_a_size_that_cannot_be_is_refused_before_anything_is_read(size):
    """An index can tell of chunks of any length: -1 would read all that is left of the file."""
    file = io.BytesIO(bytes(100))
    with pytest.raises(ValueError, match=f'a record has {size} bytes'):
        content_of(file, Record(CHUNK, 10, size))
    assert file.tell() == 0


def test_a_record_beyond_the_end_is_told():
    with pytest.raises(CutOffError):
        content_of(io.BytesIO(bytes(100)), Record(CHUNK, 90, 20))
    assert content_of(io.BytesIO(bytes(range(100))), Record(CHUNK, 90, 3)) == bytes((90, 91, 92))
