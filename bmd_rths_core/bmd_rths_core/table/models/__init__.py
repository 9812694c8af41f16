"""Models of a shake table with the specimen on it."""
