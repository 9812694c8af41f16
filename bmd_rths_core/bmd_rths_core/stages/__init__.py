"""Stages of the loop, one module each."""
