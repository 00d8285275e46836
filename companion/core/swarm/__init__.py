"""What the swarm does: who leads, in which phase, who is here, and how parts that lost one another come together."""
