"""Readers of the files that describe a ROS system: CARET, DOT, executors, rosbag2, measured times."""
