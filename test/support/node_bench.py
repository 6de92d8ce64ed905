"""The disparity node as a process of its own, and a client that talks to it over DDS."""
import array
import contextlib
import itertools
import os
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import rclpy
from checkout import CHECKOUT
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters, SetParametersAtomically
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import CameraInfo, Image
from stereo_msgs.msg import DisparityImage

with warnings.catch_warnings():  # comes with the first message that is sent, from the parser behind the messages
    warnings.simplefilter('ignore', DeprecationWarning)
    import rosidl_generator_py  # noqa: F401

LIMIT = 20.0
WIDTH, HEIGHT, SHIFT = 120, 90, 7
FOCAL_LENGTH, BASELINE, PRINCIPAL_OFFSET = 100.0, 0.2, 2.5

_domains = itertools.count(os.getpid() * 7)
_DOMAINS, _SHARES = 56, 3
_SHARE = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0').removeprefix('gw')) % _SHARES


def fresh_domain():
    """A domain of its own for each test, and most likely for each test run: of 1 .. 56, of which each process of tests
    has a third. The demo and the benchmark take those above."""
    each = _DOMAINS // _SHARES
    return next(_domains) % each + 1 + each * _SHARE


def random_dots(width=WIDTH, height=HEIGHT, shift=SHIFT, seed=1):
    """Grey left and right image (uint8) of a flat wall: x_left - x_right is `shift` everywhere."""
    wall = np.random.default_rng(seed).integers(0, 256, (height, width + shift), np.uint8)
    return np.ascontiguousarray(wall[:, :width]), np.ascontiguousarray(wall[:, shift:])


def image_message(pixels, encoding='mono8', **fields):
    rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(pixels.shape[0], -1)
    message = Image(height=pixels.shape[0], width=pixels.shape[1], encoding=encoding, step=rows.shape[1],
                    data=array.array('B', rows.tobytes()))
    for name, value in fields.items():
        setattr(message, name, value)
    return message


def camera_info(side, width=WIDTH, height=HEIGHT, baseline=BASELINE):
    cx = width / 2 - (PRINCIPAL_OFFSET if side == 'right' else 0.0)
    tx = -FOCAL_LENGTH * baseline if side == 'right' else 0.0
    p = [FOCAL_LENGTH, 0.0, cx, tx, 0.0, FOCAL_LENGTH, height / 2, 0.0, 0.0, 0.0, 1.0, 0.0]
    return CameraInfo(width=width, height=height, p=p)


def disparities(message):
    """The pixels of a DisparityImage, (H, W) float32."""
    return np.frombuffer(message.image.data, np.float32).reshape(message.image.height, message.image.width)


class NodeProcess:
    """`python -m svdm_ros`, or another `program` of the interpreter's arguments, with its log in a file."""

    def __init__(self, domain, log, *ros_arguments, program=('-m', 'svdm_ros'), **environment):
        self._log = log
        self.domain = domain
        arguments = [sys.executable, *program]
        if ros_arguments:
            arguments += ['--ros-args', *ros_arguments]
        with log.open('w') as output:
            self._process = subprocess.Popen(
                arguments, cwd=CHECKOUT, stdout=output, stderr=subprocess.STDOUT,
                env={**os.environ, 'ROS_DOMAIN_ID': str(domain), **environment})

    @property
    def log(self):
        return self._log.read_text()

    @property
    def pid(self):
        return self._process.pid

    @property
    def running(self):
        return self._process.poll() is None

    def wait_for_log(self, text, limit=LIMIT):
        """The first line with `text`."""
        end = time.monotonic() + limit
        while text not in self.log:
            assert self.running, f'the node ended with {self._process.returncode}: {self.log}'
            assert time.monotonic() < end, f'{text!r} not in the log within {limit} s: {self.log}'
            time.sleep(0.01)
        return next(line for line in self.log.splitlines() if text in line)

    def wait_until_it_handles_signals(self, limit=LIMIT):
        """Wait until SIGTERM no longer ends it on the spot, as at the start of every process."""
        end = time.monotonic() + limit
        while not _caught_signals(self._process.pid) >> (signal.SIGTERM - 1) & 1:
            assert self.running and time.monotonic() < end, self.log
            time.sleep(0.001)

    def send(self, number):
        self._process.send_signal(number)

    def exit_code(self, limit=LIMIT):
        return self._process.wait(limit)

    def end(self, number=signal.SIGTERM, limit=LIMIT):
        """Send a signal; the exit code."""
        self.send(number)
        return self.exit_code(limit)

    def kill(self):
        if self.running:
            self._process.kill()
            self._process.wait()


class Client:
    """Two cameras, a viewer of the disparity, and somebody who sets parameters."""

    def __init__(self, domain, disparity_qos=10, image_qos=10):
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node('bench', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._seconds = itertools.count(1000)
        self.received, self.troubles, self.diagnostics = [], [], []
        self.outputs = {}
        for side in ('left', 'right'):
            for kind, name in ((Image, 'image_rect'), (CameraInfo, 'camera_info')):
                topic = f'{side}/{name}'
                self.outputs[topic] = self._node.create_publisher(kind, topic, image_qos)
        self._subscriptions = {}
        self.subscribe(DisparityImage, 'disparity', self.received, disparity_qos)
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._take_diagnostics, 10)

    def subscribe(self, kind, topic, received, qos=10):
        """From now on messages of a topic go into the list `received`."""
        self._subscriptions[topic] = self._node.create_subscription(kind, topic, received.append, qos)

    def advertise(self, kind, topic, qos=10):
        """Have a publisher for a topic, for `publish`."""
        if topic not in self.outputs:
            self.outputs[topic] = self._node.create_publisher(kind, topic, qos)

    def unsubscribe(self, topic):
        self._node.destroy_subscription(self._subscriptions.pop(topic))

    def subscribers_of(self, topic):
        return self._node.count_subscribers(topic)

    def close(self):
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def _take_diagnostics(self, message):
        self.diagnostics.append({pair.key: pair.value for pair in message.status[0].values})
        self.troubles.append(message.status[0].message)

    def spin_until(self, condition, what, limit=LIMIT, each=lambda: None):
        """Spin until `condition()` is true and return its value; `each()` is called about ten times a second."""
        end, next_call = time.monotonic() + limit, 0.0
        while not (value := condition()):
            now = time.monotonic()
            assert now < end, f'not within {limit} s: {what}'
            if now >= next_call:
                next_call = now + 0.1
                each()
            self._executor.spin_once(timeout_sec=0.02)
        return value

    def spin_for(self, seconds):
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=left)

    def wait_until_ready(self, node):
        """Wait until the node tells that it is ready; the first compilation of all kernels may take its time."""
        def ready():
            assert node.running, f'the node ended: {node.log}'
            return self.hears_of_a_ready_node()

        self.spin_until(ready, 'the node is ready', limit=100.0)

    def hears_of_a_ready_node(self):
        """Whether a node has told so in its diagnostics."""
        return any(counts['state'] == 'ready' for counts in self.diagnostics)

    def wait_for_node(self):
        """Wait until the cameras and the node have found each other, and a first pair has been answered."""
        self.exchange_until(*map(image_message, random_dots(8, 6, 1)), lambda message: True, 'a first disparity')

    def publish(self, topic, message):
        self.outputs[topic].publish(message)

    def publish_infos(self, **fields):
        for side in ('left', 'right'):
            self.publish(f'{side}/camera_info', camera_info(side, **fields))

    def publish_image(self, side, message, second):
        """Stamp and publish one image message."""
        message.header.stamp.sec, message.header.stamp.nanosec = second, 5000
        message.header.frame_id = f'{side}_camera'
        self.publish(f'{side}/image_rect', message)

    def counts(self):
        """The numbers of the diagnostics to come next."""
        del self.diagnostics[:]
        self.spin_until(lambda: self.diagnostics, 'diagnostics')
        return {name: float(value) for name, value in self.diagnostics[-1].items()
                if name not in ('state', 'row alignment')}

    def publishers_of(self, topic):
        return self._node.count_publishers(topic)

    def next_second(self):
        """A second for a stamp, after all before."""
        return next(self._seconds)

    def publish_pair(self, left, right, second=None, right_delay_ns=0):
        """Stamp and publish two image messages; the second of their stamps, one more than the last by default."""
        second = self.next_second() if second is None else second
        for side, message, delay in (('left', left, 0), ('right', right, right_delay_ns)):
            message.header.stamp.sec, message.header.stamp.nanosec = second, 5000 + delay
            message.header.frame_id = f'{side}_camera'
            self.publish(f'{side}/image_rect', message)
        return second

    def exchange(self, left, right, second=None, right_delay_ns=0):
        """Publish one pair and return the disparity that answers it."""
        before = len(self.received)
        second = self.publish_pair(left, right, second, right_delay_ns)
        return self.spin_until(
            lambda: next((message for message in self.received[before:] if message.header.stamp.sec == second), None),
            f'the disparity of second {second}')

    def exchange_until(self, left, right, condition, what):
        """Publish pairs until an answer fulfils `condition`; that answer.

        Also the way to begin: topics match at either end on their own time, and the first images may find nobody.
        """
        before = len(self.received)
        return self.spin_until(
            lambda: next((message for message in self.received[before:] if condition(message)), None), what,
            each=lambda: self.publish_pair(left, right))

    def wait_for_trouble(self, text, each=lambda: None):
        """Wait until the diagnostics tell of `text`."""
        del self.troubles[:]
        return self.spin_until(
            lambda: next((trouble for trouble in self.troubles if text in trouble), None), f'{text!r} in diagnostics',
            each=each)

    def call(self, service_type, name, request):
        client = self._node.create_client(service_type, f'/disparity_node/{name}')
        try:
            self.spin_until(client.service_is_ready, f'service {name}')
            future = client.call_async(request)
            self.spin_until(future.done, f'an answer of {name}')
            return future.result()
        finally:
            self._node.destroy_client(client)

    def set_parameters(self, **values):
        """One by one; name -> SetParametersResult."""
        request = SetParameters.Request(parameters=_parameters(values))
        return dict(zip(values, self.call(SetParameters, 'set_parameters', request).results, strict=True))

    def set_atomically(self, **values):
        request = SetParametersAtomically.Request(parameters=_parameters(values))
        return self.call(SetParametersAtomically, 'set_parameters_atomically', request).result

    def get_parameters(self, *names):
        values = self.call(GetParameters, 'get_parameters', GetParameters.Request(names=list(names))).values
        return {name: parameter_value_to_python(value) for name, value in zip(names, values, strict=True)}

    def describe_parameters(self, *names):
        request = DescribeParameters.Request(names=list(names))
        return self.call(DescribeParameters, 'describe_parameters', request).descriptors

    def send_malformed_request(self):
        """A parameter of a type that does not exist; no answer can be expected."""
        client = self._node.create_client(SetParameters, '/disparity_node/set_parameters')
        self.spin_until(client.service_is_ready, 'service set_parameters')
        parameter = ParameterMessage(name='alpha')
        parameter.value.type = 99
        client.call_async(SetParameters.Request(parameters=[parameter]))


def _caught_signals(pid):
    """Bit mask of the signals a process has handlers for."""
    status = Path(f'/proc/{pid}/status').read_text()
    return int(next(line for line in status.splitlines() if line.startswith('SigCgt')).split()[1], 16)


def _parameters(values):
    return [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]


@contextlib.contextmanager
def running_node(folder, *ros_arguments, disparity_qos=10, image_qos=10, **environment):
    """A node that is ready and matched with a client; both are gone afterwards."""
    domain = fresh_domain()
    node = NodeProcess(domain, folder / 'node.log', *ros_arguments, **environment)
    client = Client(domain, disparity_qos, image_qos)
    try:
        client.wait_until_ready(node)
        yield node, client
    finally:
        client.close()
        node.kill()
