"""Measurements as records: single-writer logs, kept on disk, passed on by radio, acknowledged by the base station.

record.py and summary.py have the values, frames.py puts them on the wire, store.py keeps them on disk. In each tick
exchange.py takes what came (holdings.py: what this node has, peers.py: what others have and lack), has write_queue.py
see to the disk, and sends what others lack, within what airtime.py allows.
"""
