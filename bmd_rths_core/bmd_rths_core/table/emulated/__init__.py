"""A virtual table controller: the other end of the wire, with faults on demand."""
