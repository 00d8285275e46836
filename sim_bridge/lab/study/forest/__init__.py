"""Flights of many point masses through many forests: the whole agents, without wire, autopilots' habits or dynamics."""
