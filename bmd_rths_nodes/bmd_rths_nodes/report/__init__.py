"""Test reports: what they say in words, and how they become a web page."""
