import numpy as np
import pytest
from scenes import noise, shifted_wall

from svdm_core.benchmark.runs import BenchmarkPair, growth, ratios, run_benchmark


def test_a_scaled_pair_keeps_its_truth():
    truth = np.full((40, 80), 12, np.float32)
    truth[:, :8] = np.inf
    pair = BenchmarkPair(noise(40, 80, 3), noise(40, 80, 3), truth).scaled(40, 20).grey()
    assert pair.left.shape == (20, 40) == pair.ground_truth.shape
    assert (pair.ground_truth[:, 4:] == 6).all() and np.isinf(pair.ground_truth[:, :4]).all()


def test_every_contender_is_timed_and_judged():
    left, right = shifted_wall(48, 100, 6)
    pair = BenchmarkPair(left, right, np.full((48, 100), 6, np.float32))
    rounds = []
    names = ['svdm-default', 'bm']
    figures = run_benchmark(pair, names, 16, 1, 3, lambda: rounds.append(1), memory=False)
    assert list(figures) == names and len(rounds) == 3
    for name, value in figures.items():
        assert 0 < value['low_ms'] <= value['median_ms'] <= value['high_ms']
        assert value['mde_per_s'] == pytest.approx(48 * 100 * 16 / 1e3 / value['median_ms'])
        assert value['mde_per_s_core'] == pytest.approx(value['mde_per_s'])
        assert value['bad2'] < 40  # BM has no answer near the border
        assert bool(value['stages_ms']) == name.startswith('svdm-')
    ratio = ratios(figures)
    assert ratio['bm'] == {'bm': 1.0}
    assert ratio['svdm-default']['bm'] == figures['svdm-default']['median_ms'] / figures['bm']['median_ms']


def test_growth_is_the_exponent():
    assert growth([1, 2, 4, 8], [3 * n**1.3 for n in (1, 2, 4, 8)]) == pytest.approx(1.3)
