"""Topics, message codecs and bags of real-time hybrid simulation, without rclpy."""
