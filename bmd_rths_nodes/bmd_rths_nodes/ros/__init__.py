"""The one place, besides the nodes themselves, that knows rclpy."""
