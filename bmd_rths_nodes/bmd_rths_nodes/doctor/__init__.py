"""What a computer needs to run a test in real time, looked at and measured, in plain words."""
