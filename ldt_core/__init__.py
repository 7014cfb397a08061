"""The learning digital twin, without ROS: records, physics, models, detectors, and the loop."""
