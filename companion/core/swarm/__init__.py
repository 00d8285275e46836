"""The swarm: leader, phase, roster, and the way in which parts that lost one another come together."""
