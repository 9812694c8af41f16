"""The page that shows a test live, or a recording: a small web server that follows bags and imports no ROS."""
