"""Settings that must be in place before anything of ROS is loaded."""
import os
import tempfile

from hypothesis import settings

from svdm_core.runtime.thread_waiting import wait_briefly

wait_briefly()  # processes of tests share the cores: threads that spin while they wait took up to half of the time
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
os.environ['ROS_LOG_DIR'] = tempfile.mkdtemp(prefix='svdm_test_log_')
settings.register_profile('steady', deadline=None, derandomize=True)
settings.load_profile('steady')
settings.register_profile('long', max_examples=2000, deadline=None)
"""`pytest --hypothesis-profile=long`: for the tests that feed mutated files."""
