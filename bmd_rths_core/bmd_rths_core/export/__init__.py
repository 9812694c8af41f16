"""Take the data of a run home: tables of its signals with names, units and meaning, and the files they go into."""
