"""Returns of stems: returns.py, those that a pass was fitted with; returns_file.py, returns_log.py, their file and what
feeds it in flight; returns_reader.py reads it.

`companion.survey` makes them, `companion.stand.cloud` a point cloud of those of all vehicles.
"""
