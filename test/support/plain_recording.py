"""What the small recording holds, read from a bag as it should be."""
import pytest
from recordings import contents, write
from small_recordings import few


@pytest.fixture(scope='module')
def plain(tmp_path_factory):
    return contents(write(tmp_path_factory.mktemp('plain') / 'bag', few()))
