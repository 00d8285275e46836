"""Bytes under way: UDP ports, the radio hub, routes of autopilots, inboxes; beacons are decoded once, on to the air."""
