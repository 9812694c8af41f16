"""Compensators of the table, one module each."""
