"""Sensors, one class each, listed in `table`: their messages, decoding, freshness, what preflight and doctor ask.

Pure: no sockets, no files, no clock. `SensorSource` in companion.mavlink.sensor_source is the contract.
"""
