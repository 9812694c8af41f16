"""Nodes of a laboratory, in place of nodes of bmd_rths."""
