"""The live map: a process of its own that gets a flight's rows, and serves the replay's page with them as a stream.

The flight writes to a socket that never makes it wait, and reads from it what a viewer asks for. Everything else is
done here: what is drawn is worked out only while somebody looks. docs/reference/live.md describes the stream.
"""
