"""Ports of programs for people: admission of connections, and the addresses under which a port is reached."""
