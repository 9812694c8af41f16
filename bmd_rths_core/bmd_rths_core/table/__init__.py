"""Table controllers and the models behind the simulated one."""
