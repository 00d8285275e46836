"""A point cloud of a stand: merge.py puts all vehicles' returns into the frame of the fused stems, las.py writes it."""
