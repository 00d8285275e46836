"""MAVLink frames: found in bytes, passed by the gate of a link, decoded and packed; long texts put together."""
