"""Frames of the swarm's radio that are signed: who made them, that they are new, and what until then they may do.

A frame passes `frame_mac` (the group's MAC), then its sender's `stream` (this boot of it, and its counter); what others
may believe of it follows from the sender's `manifest`. `guard` is what an endpoint has: signed, or open.
"""
