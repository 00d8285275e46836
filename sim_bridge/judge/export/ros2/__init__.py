"""ROS 2 messages of a flight: their types and frames, out of telemetry; a bag of them."""
