"""The node over DDS, with images that are not rectified."""
import numpy as np
import pytest
from node_bench import image_message, random_dots, running_node


@pytest.mark.slow
def test_rows_that_do_not_correspond_are_told(tmp_path):
    left, right = random_dots()
    pair = [image_message(left), image_message(np.roll(right, 2, axis=0))]
    with running_node(tmp_path) as (node, client):
        client.wait_for_node()
        client.publish_infos()
        client.exchange_until(*pair, lambda message: message.f > 0 and message.t > 0, 'camera_info taken')
        trouble = client.wait_for_trouble('rows do not correspond', each=lambda: client.publish_pair(*pair))
        values = client.diagnostics[-1]
        assert 'features are 2.00 px lower in the right image' in trouble
        assert values['vertical offset (px)'] == '2.00' and int(values['features']) >= 60
        node.wait_for_log('calibrate the cameras anew')
        assert node.end() == 0
