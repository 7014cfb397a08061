"""Runs without ROS."""
