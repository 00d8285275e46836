"""Other vehicles in scans: those that move, those that hover, and places of silent ones that are seen empty."""
