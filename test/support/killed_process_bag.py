"""process_bag in processes that kill themselves at a given step; a program that takes requests from its standard input.

A request is a line of JSON: the values of `process_bag` below. The answer is the exit code, minus
the signal that ended it. Each runs in a fork of this process, in which all is imported that takes time.
"""
import contextlib
import json
import os
import signal
import sys
import tempfile
from pathlib import Path

import numpy as np
from recordings import stereo, write

from svdm_ros.bags.process import processing
from svdm_ros.bags.process_bag import main
from svdm_ros.bags.writing import partial_bag
from svdm_ros.calibration.geometry import StereoGeometry
from svdm_ros.frames.frame_processing import ProcessedFrame
from svdm_ros.frames.matched_frame import MatchedFrame

STEPS = ('os.rename', 'os.remove', 'os.rmdir', 'os.mkdir', 'open')
"""The events by which Python tells of what changes a folder; os.replace is a rename, os.unlink a remove."""


class QuickProcessor:
    """In place of the matcher, whose threads survive no fork: the grey of the left image is its disparity."""

    def __init__(self, rows):
        pass

    def warm_up(self, _parameters):
        pass

    def process(self, frame, parameters):
        grey = np.frombuffer(frame.left.data, np.uint8).reshape(frame.left.height, frame.left.width)
        everywhere = np.ones(grey.shape, bool)
        matched = MatchedFrame(frame.left.header, grey, grey.astype(np.float32), everywhere, everywhere, 1.0,
                               StereoGeometry(400.0, 0.5), parameters)
        return ProcessedFrame(matched, {'total': 1.0}, '')


def process_bag(arguments, log, kill_at, begin):
    """The command, which kills itself before step `kill_at`, counted from the last message or from the renaming on."""
    stream = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(stream, 1)
    os.dup2(stream, 2)
    steps = 0
    counts = False
    last_commit, place = partial_bag.PartialBag.commit, partial_bag.put_in_place

    def commit(bag, state, *, now=False):
        nonlocal counts
        counts = counts or (now and begin == 'last message')
        last_commit(bag, state, now=now)

    def put_in_place(*arguments):
        nonlocal counts
        counts = True
        place(*arguments)

    def step(event, values):
        nonlocal steps
        writes = event != 'open' or (isinstance(values[2], int) and values[2] & (os.O_WRONLY | os.O_RDWR))
        if counts and event in STEPS and writes:
            if steps == kill_at:
                os.kill(os.getpid(), signal.SIGKILL)
            steps += 1

    partial_bag.PartialBag.commit, partial_bag.put_in_place = commit, put_in_place
    sys.addaudithook(step)
    code = main(arguments)
    sys.stdout.flush()
    os._exit(code)  # without the half second in which Python takes all modules down


def warm_up():
    """Have everything imported that a run needs."""
    processing.FrameProcessor = QuickProcessor
    partial_bag.SEGMENT_BYTES = 30_000
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(None):
        bag = write(Path(folder) / 'bag', stereo(1))
        assert main([str(bag), str(Path(folder) / 'out'), '--preview', 'png']) == 0


def serve():
    warm_up()
    for line in sys.stdin:
        child = os.fork()
        if not child:
            process_bag(*json.loads(line))
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)


if __name__ == '__main__':
    serve()
