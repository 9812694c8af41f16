"""Figures for print, by matplotlib: the only package that needs it. It draws, and computes nothing."""

from __future__ import annotations

#: Formats a figure can be written in.
FORMATS = ("png", "svg")
