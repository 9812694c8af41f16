"""Buildings: masses, story springs, damping."""
