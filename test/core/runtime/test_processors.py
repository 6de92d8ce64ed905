import os

import pytest

from svdm_core.runtime import processors


def test_the_processors_are_those_this_process_may_use():
    allowed = os.sched_getaffinity(0)
    try:
        os.sched_setaffinity(0, {min(allowed)})
        assert processors.processor_count() == 1
    finally:
        os.sched_setaffinity(0, allowed)
    assert processors.processor_count() == len(allowed)


def test_what_threads_have_waited_is_summed_in_seconds(tmp_path, monkeypatch):
    for number, waited in ((1, 2_000_000_000), (2, 500_000_000)):
        (tmp_path / str(number)).mkdir()
        (tmp_path / str(number) / 'schedstat').write_text(f'123 {waited} 7\n')
    monkeypatch.setattr(processors, '_THREADS', tmp_path)
    assert processors.waited_seconds() == pytest.approx(2.5)


def test_where_the_system_does_not_count_nothing_is_said(tmp_path, monkeypatch):
    (tmp_path / '1').mkdir()
    monkeypatch.setattr(processors, '_THREADS', tmp_path)
    assert processors.waited_seconds() is None
