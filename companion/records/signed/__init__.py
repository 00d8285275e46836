"""Records in a swarm with keys: each is signed by who made it, and only the base station's signed word frees one.

keys.py signs and checks, messages.py puts it on the wire, stored.py keeps it on disk; exchange.py is the exchange of
records with what others say held to it, by intake.py (what is checked, and how much of it) and acknowledgements.py.
"""
