"""`companion watch`: what the swarm's radio says, shown on a tablet. It hears, and never sends to a vehicle."""
