"""What the own sensors see: scans become the obstacle map, and clear ghost tracks of vehicles that have moved on."""
