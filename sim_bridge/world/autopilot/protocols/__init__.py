"""MAVLink services of any autopilot: channels, parameters, fence plans, message streams, and a recorder's port."""
