import pytest

from svdm_core.benchmark.contenders import all_methods, contender_names, is_own, threads_used, work_of


def test_names_of_all_kinds_each_once(tmp_path):
    path = tmp_path / 'my.yaml'
    path.write_text('/**:\n  ros__parameters: {}\n')
    assert contender_names(['fast', ' bm', 'svdm-fast', str(path)]) == ['svdm-fast', 'bm', str(path)]
    path.write_text('/**:\n  ros__parameters:\n    w_p: 2\n')
    with pytest.raises(ValueError, match=r'my\.yaml: w_p = 2 is not allowed'):
        contender_names([str(path)])


def test_the_work_of_each_method_is_named():
    works = {name: work_of(name) for name in contender_names(all_methods())}
    assert works['svdm-accurate'] == '4 paths, 2 views' and works['svdm-fast'] == '3 paths, 1.5 views'
    assert works['sgbm-3way'] == '3 paths, 1 view' and works['sgbm-hh4'] == '4 paths, 1 view'


def test_threads_that_a_method_cannot_use_do_not_count():
    used = {name: threads_used(name, 8) for name in ('svdm-fast', 'bm', 'sgbm-3way', 'sgbm-hh4', 'sgbm-hh')}
    assert list(used.values()) == [8, 8, 4, 8, 1]
    assert threads_used('sgbm-3way', 2) == 2 and not is_own('bm')
