"""Draw figures for print by matplotlib; nothing is computed here."""

from __future__ import annotations

#: Formats a figure can be written in.
FORMATS = ("png", "svg")
