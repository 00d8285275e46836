"""Records of other sensors, by `[[payload]]`: sample.py, one value with its place; recorder.py makes them in flight.

Pure: no sockets, no clock. `companion.sensors.payload` reads the sensors' messages.
"""
