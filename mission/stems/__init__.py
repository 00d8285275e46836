"""Stem maps read and written: CSV, GeoJSON, GeoPackage, with UTM."""
