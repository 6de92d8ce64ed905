"""Runs a launch file as `ros2 launch FILE NAME:=VALUE ...` does, where launch is not installed, as with the ROS wheels.

It knows what the launch files of this package use and no more. The nodes it starts are real processes.
"""
import os
import signal
import subprocess
import sys
import tempfile
import types
from pathlib import Path
from typing import NoReturn

import yaml
from ament_index_python.packages import get_package_prefix


class Context:
    def __init__(self, argv):
        self.argv = argv
        self.values = dict(word.split(':=', 1) for word in argv)
        self.processes = []


class LaunchDescription:
    def __init__(self, entities):
        self.entities = entities

    def visit(self, context):
        for entity in self.entities:
            entity.visit(context)


class DeclareLaunchArgument:
    def __init__(self, name, *, default_value, description):
        self.name, self.default = name, default_value

    def visit(self, context):
        context.values.setdefault(self.name, self.default)


class LaunchConfiguration:
    def __init__(self, name):
        self.name = name

    def perform(self, context):
        return context.values[self.name]


class EnvironmentVariable:
    def __init__(self, name, *, default_value):
        self.name, self.default = name, default_value

    def perform(self, context):
        return os.environ.get(self.name, self.default)


class SetEnvironmentVariable:
    def __init__(self, name, value):
        self.name, self.value = name, value

    def visit(self, context):
        os.environ[self.name] = self.value.perform(context)


class OpaqueFunction:
    def __init__(self, *, function):
        self.function = function

    def visit(self, context):
        LaunchDescription(self.function(context)).visit(context)


class LogInfo:
    def __init__(self, *, msg):
        self.msg = msg

    def visit(self, context):
        print(f'[INFO] [launch.user]: {self.msg}', flush=True)


class Node:
    def __init__(self, *, package, executable, name, namespace, parameters, remappings, arguments=(), output='log'):
        self.command = [f'{get_package_prefix(package)}/lib/{package}/{executable}', *arguments, '--ros-args']
        self.rules = [('__node', name), *([('__ns', f'/{namespace.lstrip("/")}')] if namespace else []), *remappings]
        self.parameters = parameters

    def visit(self, context):
        rules = [word for name, value in self.rules for word in ('-r', f'{name}:={value}')]
        files = [word for given in self.parameters for word in ('--params-file', parameter_file(given))]
        print(f'[INFO] [launch]: {" ".join([*self.command, *rules, *files])}', flush=True)
        context.processes.append(subprocess.Popen([*self.command, *rules, *files]))


def parameter_file(given) -> str:
    if isinstance(given, str):
        return given
    with tempfile.NamedTemporaryFile('w', prefix='launch_params_', suffix='.yaml', delete=False) as file:
        yaml.safe_dump({'/**': {'ros__parameters': given}}, file)
    return file.name


def install() -> None:
    """Make `import launch` and `import launch_ros` find the classes above."""
    names = {
        'launch': {'LaunchContext': Context, 'LaunchDescription': LaunchDescription},
        'launch.actions': {action.__name__: action for action in (
            DeclareLaunchArgument, LogInfo, OpaqueFunction, SetEnvironmentVariable)},
        'launch.substitutions': {
            'EnvironmentVariable': EnvironmentVariable, 'LaunchConfiguration': LaunchConfiguration},
        'launch_ros': {},
        'launch_ros.actions': {'Node': Node},
    }
    for name, members in names.items():
        sys.modules[name] = types.ModuleType(name)
        vars(sys.modules[name]).update(members)


def main() -> int:
    file, *arguments = sys.argv[1:]
    install()
    context = Context(arguments)

    def stop(number, frame) -> NoReturn:
        sys.exit(0)

    signal.signal(signal.SIGINT, stop)
    signal.signal(signal.SIGTERM, stop)
    try:
        module = {'__file__': file}
        exec(compile(Path(file).read_text(), file, 'exec'), module)
        module['generate_launch_description']().visit(context)
        for process in context.processes:
            process.wait()
    except Exception as error:
        print(f'[ERROR] [launch]: Caught exception in launch (see debug for traceback): {error}', flush=True)
        return 1
    finally:
        for process in context.processes:
            process.send_signal(signal.SIGINT)
        for process in context.processes:
            process.wait()
    return 0


if __name__ == '__main__':
    sys.exit(main())
