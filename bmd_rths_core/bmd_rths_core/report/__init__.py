"""What a test report shows, computed from the record of a run: no drawing, no text formats."""
