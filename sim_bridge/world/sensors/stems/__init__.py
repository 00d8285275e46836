"""Trunks as `[forest.shapes]` has them, for raw lidars: drawn by `shapes`, met by rays in `stem_scan`."""
