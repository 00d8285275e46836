"""Servers that strangers reach: bounds of their connections, and addresses at which they are reached."""
