"""Recordings without a running ROS: rosbag2 and ROS 1 bags read and written with rosbags. Imports no rclpy."""
