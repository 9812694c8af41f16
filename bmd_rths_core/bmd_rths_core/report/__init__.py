"""Test reports as pages: of one run, section by section, or of several beside each other."""
