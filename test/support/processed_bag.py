"""`process_bag` as the target of a process, which finds it by the name of its module."""
import os
import sys

from svdm_ros.bags.process_bag import main
from svdm_ros.bags.writing import partial_bag

SEGMENT = 500_000


def process(bag, output):
    """Its output goes to OUTPUT.log; files of the bag are small, and its pairs take long enough to be killed within."""
    log = os.open(output.with_suffix('.log'), os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    os.dup2(log, 1)
    os.dup2(log, 2)
    partial_bag.SEGMENT_BYTES, partial_bag.VOLUME_BYTES = SEGMENT, 4 * SEGMENT
    sys.exit(main([str(bag), str(output), '--set', 'num_threads=1', 'median_scope=all', 'w_p=21']))
