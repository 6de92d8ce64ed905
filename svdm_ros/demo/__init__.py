"""The demo: disparity_node at work on a real stereo pair, re-tuned while it runs.

Three processes: `svdm_ros.processes.camera` plays the camera, the node is the real one, and the caller's process
subscribes, sets parameters and judges. `python -m svdm_ros.demo` runs it.
"""
