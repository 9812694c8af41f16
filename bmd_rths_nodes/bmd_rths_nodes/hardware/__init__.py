"""Table controllers outside of this process, and the virtual one: sockets and clock."""
