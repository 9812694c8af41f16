"""The loop: how it is built, in which order it runs, and when a step is due."""
