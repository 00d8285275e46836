"""The safety filter, which every setpoint passes last, and what it reckons with: response, disturbance, clearances."""
