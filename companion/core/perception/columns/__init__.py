"""Columns of air above places on the ring that own rays have seen free: `column` one, `column_map` those of a ring."""
