"""The course of the demo, from the start of the node to the files with the result."""
from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from numpy.typing import NDArray
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

from svdm_core import load_preset
from svdm_core.presets import preset_folder

from ..command_line.interrupts import deferred_interrupts
from ..processes.camera import SENT
from ..processes.children import Child, isolated_environment
from ..processes.dds_profile import write_profile
from ..processes.scene import MOTORCYCLE, NUM_DISPARITIES, Scene, load_scene
from ..processes.session import Frame, Session
from . import summary as figures
from .depth_picture import draw_depth
from .depth_view import DepthView, Space
from .display import Display
from .output_folder import prepare_output_folder
from .picture import draw_comparison

START_PRESET, TUNED_PRESET, LAST_PRESET = 'paper_start', 'paper', 'default'
TUNED = ('alpha', 'sigma_s', 'sigma_c', 'w_p')  # what the paper's study optimises
START_TIMEOUT = 30.0  # s
COMPILE_TIMEOUT = 300.0  # s, on a slow machine
FRAME_TIMEOUT = 20.0  # s


@dataclasses.dataclass(frozen=True, slots=True)
class Settings:
    """output: folder for the result. frames: to be received in each phase. rate: pairs sent a second, Hz."""

    output: Path
    frames: int = 20
    rate: float = 10.0


@dataclasses.dataclass(frozen=True, slots=True)
class Recording:
    """What a run has gathered: the frames of each phase, everything received, and the traffic's numbers.

    before, after the change of parameters; last: with LAST_PRESET, and space, what came with one of these.
    """

    before: Sequence[Frame]
    after: Sequence[Frame]
    last: Sequence[Frame]
    space: Space
    received: Sequence[Frame]
    traffic: figures.Traffic


def run_demo(settings: Settings) -> dict[str, Any]:
    """Run it all and write the pictures and summary.json; returns the summary. Raises RunError."""
    folder = prepare_output_folder(settings.output)
    os.environ.update(isolated_environment(
        folder / 'ros_log', write_profile(preset_folder() / 'fastdds.xml', folder / 'fastdds.xml')))
    with Display() as display:
        recording = record(settings, folder, display)
        with display.stage('Comparing with the ground truth, drawing'):
            summary = evaluate(recording, folder)
    display.result(summary)
    for name in ('comparison.png', 'depth.png', 'summary.json'):
        display.line(f'written: {os.path.relpath(folder / name)}')
    return summary


def record(settings: Settings, folder: Path, display: Display) -> Recording:
    """Start the node and the camera, receive, re-tune, receive again. Nothing is left running."""
    with contextlib.ExitStack() as stack:
        preset = preset_folder() / f'{START_PRESET}.yaml'
        node = _started(stack, 'node', folder / 'node.log', 'svdm_ros', '--ros-args',
                        '--params-file', str(preset), '-p', f'num_disparities:={NUM_DISPARITIES}')
        children = [node]
        # It would keep the node busy for a minute while the camera sends.
        warm_up = _started(stack, 'compilation', folder / 'warm_up.log', 'svdm_ros.demo.warm_up', LAST_PRESET)

        def check() -> None:
            for child in children:
                child.check()

        session = stack.enter_context(_session(check))
        with display.stage('Starting disparity_node, a process of its own'):
            session.wait_for_node(START_TIMEOUT)
        with display.stage('Preparing its kernels (the first time: a minute)'):
            session.wait_until_ready(COMPILE_TIMEOUT, 'the node has been preparing its kernels')
            session.wait_for(warm_up.is_done, COMPILE_TIMEOUT, f'the kernels of {LAST_PRESET} have been compiling')

        with display.stage(f'Starting the camera: Motorcycle at {settings.rate:g} Hz'):
            camera = _started(stack, 'camera', folder / 'publisher.log', 'svdm_ros.processes.camera',
                              '--rate', str(settings.rate))
            children.append(camera)
            session.listen(START_TIMEOUT)
            session.wait_for(lambda: bool(session.frames), START_TIMEOUT, 'no disparity image arrived')
        with display.stage(f'Receiving with preset {START_PRESET}', settings.frames) as progress:
            before = session.collect(settings.frames, 0, FRAME_TIMEOUT, progress)

        values = _values(TUNED_PRESET)
        with display.stage(f'Setting {", ".join(values)} while it runs'):
            changed_at = session.set_parameters(values)
        with display.stage('Receiving with the new parameters', settings.frames) as progress:
            # Sent after the node's consent: matched with the new set. A frame in work at the change belongs to neither.
            after = session.collect(settings.frames, changed_at, FRAME_TIMEOUT, progress)

        with display.stage(f'Setting preset {LAST_PRESET} while it runs, listening to depth and points'):
            view = DepthView(session)
            space = view.wait(session.set_parameters(load_preset(LAST_PRESET).as_dict()), COMPILE_TIMEOUT)
            seen_at = time.time_ns()  # the first frame has loaded the kernels
        with display.stage(f'Receiving with preset {LAST_PRESET}', settings.frames) as progress:
            last = session.collect(settings.frames, seen_at, FRAME_TIMEOUT, progress)

        with display.stage('Stopping the camera, counting'):
            children.remove(camera)
            camera.stop()
            sent = camera.output().count(SENT)
            session.wait_until_settled(sent)
        traffic = figures.Traffic(sent, len(session.frames), session.superseded())
        return Recording(before, after, last, space, session.frames, traffic)


def evaluate(recording: Recording, folder: Path) -> dict[str, Any]:
    """Judge the last frame of each phase; writes the pictures and summary.json, returns the summary."""
    scene = load_scene()
    offsets = {name: figures.pixel_offset(frames[-1].disparity, MOTORCYCLE.principal_offset)
               for name, frames in (('before', recording.before), ('after', recording.after),
                                    (LAST_PRESET, recording.last))}
    summary = {
        **recording.traffic.as_dict(),
        **figures.speed(recording.received),
        'before': _phase(recording.before, offsets['before'], scene),
        'after': _phase(recording.after, offsets['after'], scene),
        LAST_PRESET: _phase(recording.last, offsets[LAST_PRESET], scene),
        'changed': figures.changed(_values(START_PRESET), _values(TUNED_PRESET)),
    }
    draw_comparison(folder / 'comparison.png', scene, offsets['before'], offsets['after'], summary)
    draw_depth(folder / 'depth.png', scene, recording.space,
               f'What a robot gets from the same node with preset {LAST_PRESET}: depth and points, from '
               f'{len(recording.space.points):,} pixels of a pair; mean error of the disparity '
               f'{summary[LAST_PRESET]["avgerr"]:.2f} px')
    (folder / 'summary.json').write_text(json.dumps(summary, indent=2) + '\n')
    return summary


def _phase(frames: Sequence[Frame], offset: NDArray[np.float32], scene: Scene) -> dict[str, Any]:
    """Figures of one phase. All its frames show the same scene: `distinct` (to the bit) is 1 where all is well."""
    return {
        **figures.quality(offset, scene.ground_truth),
        'frames': len(frames),
        'distinct': len({frame.disparity.tobytes() for frame in frames}),
        **figures.speed(frames),
    }


def _values(preset: str) -> dict[str, Any]:
    parameters = load_preset(preset).as_dict()
    return {name: parameters[name] for name in TUNED}


def _started(stack: contextlib.ExitStack, name: str, log: Path, module: str, *arguments: str) -> Child:
    """A child that `stack` stops: a signal that comes between its start and that would leave it running."""
    with deferred_interrupts():
        child = Child(name, log, module, *arguments)
        stack.callback(child.stop)
    return child


@contextlib.contextmanager
def _session(check: Callable[[], None]) -> Iterator[Session]:
    # Ctrl-C stays Python's, so that it ends this function and with it the children.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        yield Session(check)
    finally:
        try_shutdown()
