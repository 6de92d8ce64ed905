"""The node over DDS, with images that are not rectified."""
import numpy as np
import pytest
from node_bench import PRINCIPAL_OFFSET, SHIFT, disparities, image_message, random_dots, running_node


@pytest.mark.slow
def test_rows_that_do_not_correspond_are_aligned_or_told(tmp_path):
    left, right = random_dots()
    pair = [image_message(left), image_message(np.roll(right, 2, axis=0))]
    with running_node(tmp_path) as (node, client):
        client.wait_for_node()
        client.publish_infos()
        client.exchange_until(*pair, lambda message: message.f > 0 and message.t > 0, 'camera_info taken')
        client.spin_until(lambda: 'rows aligned' in node.log, 'rows aligned', each=lambda: client.publish_pair(*pair))
        client.spin_until(lambda: 'row alignment points' in client.diagnostics[-1], 'the alignment in the diagnostics')
        values = client.diagnostics[-1]
        assert values['row alignment'] == 'track'
        assert float(values['row alignment centre (px)']) == pytest.approx(2, abs=0.1)
        answer = client.exchange(*pair)
        assert np.mean(np.abs(disparities(answer) - (SHIFT - PRINCIPAL_OFFSET))[10:-10, 20:-10] < 0.5) > 0.95
        assert client.set_parameters(align_rows='off')['align_rows'].successful
        trouble = client.wait_for_trouble('rows do not correspond', each=lambda: client.publish_pair(*pair))
        values = client.diagnostics[-1]
        assert 'features are 2.00 px lower in the right image' in trouble and 'row alignment points' not in values
        assert values['vertical offset (px)'] == '2.00' and int(values['features']) >= 60
        node.wait_for_log('calibrate the cameras anew')
        assert node.end() == 0
