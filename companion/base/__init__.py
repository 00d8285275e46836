"""The base station: hears the swarm's radio, stores its records, acknowledges them. station.py; command.py runs it."""
