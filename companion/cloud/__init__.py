"""Returns of stems: returns.py, those that one pass was fitted with, and their form; returns_file.py, returns_log.py,
the file of them and what feeds it in flight.

`companion.survey` makes them in flight, `companion.stand.cloud` a point cloud of those of all vehicles.
"""
