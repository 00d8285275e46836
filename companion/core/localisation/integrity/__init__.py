"""Can the own position be true? `own_position` puts together the gate of jumps, and fixes held against the own way."""
