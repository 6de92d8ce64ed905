"""The house rules that a machine can check: sizes, doors and imports of svdm_core."""
import ast
import subprocess
import sys

import pytest
from checkout import CHECKOUT

MODULES = sorted((CHECKOUT / 'svdm_core').rglob('*.py'))
ROS = {'rclpy', 'sensor_msgs', 'stereo_msgs', 'std_msgs', 'rcl_interfaces', 'builtin_interfaces', 'svdm_ros'}

MOST_PARAMETERS, MOST_LINES, LONGEST_FILE = 8, 60, 400


def functions(path):
    return [node for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]


def parameter_count(function):
    """Without self and cls."""
    given = function.args
    names = [argument.arg for argument in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    return len([name for name in names if name not in ('self', 'cls')]) + bool(given.vararg) + bool(given.kwarg)


@pytest.mark.parametrize('path', MODULES, ids=lambda path: str(path.relative_to(CHECKOUT)))
def test_a_module_keeps_the_rules(path):
    lines = len(path.read_text().splitlines())
    assert lines <= LONGEST_FILE, f'{lines} lines: part it'
    broad = {function.name: parameter_count(function) for function in functions(path)}
    assert {name: count for name, count in broad.items() if count > MOST_PARAMETERS} == {}
    long = {function.name: function.end_lineno - function.lineno + 1 for function in functions(path)}
    assert {name: count for name, count in long.items() if count > MOST_LINES} == {}
    assert not ROS & set(imported(path)), 'svdm_core must do without ROS'


def test_one_place_alone_knows_of_what_reads_recordings():
    knowing = [path.relative_to(CHECKOUT).as_posix() for path in MODULES
               if any(isinstance(node, ast.Constant) and str(node.value).startswith('svdm_ros.')
                      for node in ast.walk(ast.parse(path.read_text())))]
    assert knowing == ['svdm_core/evaluation/recordings.py']


def imported(path):
    """The packages it imports, anywhere."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name.split('.')[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield (node.module or '').split('.')[0]


def test_importing_it_loads_nothing_heavy_not_even_the_table_of_parameters():
    code = ('import sys, svdm_core; svdm_core.MatcherParameters(aggregation="box")\n'
            'print({"numba", "numpy", "cv2", "rclpy"} & set(sys.modules))')
    run = subprocess.run([sys.executable, '-c', code], cwd=CHECKOUT, capture_output=True, text=True, timeout=60)
    assert run.stdout == 'set()\n', run.stderr
