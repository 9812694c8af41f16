"""Command line ``bmd-rths``."""
