"""The matcher of `svdm_core` as a ROS 2 node."""
