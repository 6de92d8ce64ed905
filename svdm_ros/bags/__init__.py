"""Recordings without a running ROS: rosbag2 and ROS 1 bags, by way of rosbags. Only `play` imports rclpy."""
