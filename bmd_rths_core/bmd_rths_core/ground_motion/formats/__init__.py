"""Readers of ground-motion files, one format a module."""
