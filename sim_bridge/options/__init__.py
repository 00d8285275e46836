"""Options of each command, by its name; light, so that --help does not wait for what flies."""
