"""The node graph: thin rclpy nodes that convert, call the core, and publish."""
