"""Lidars read by their own protocols, and sent as sectors or rays: `companion lidar`, a program beside the agent.

In the order in which data goes: `models` names drivers and ranges, a driver (`rplidar`, `ldrobot`, `livox`) makes
returns of bytes, `sectors` or `rays` make a scan of returns as `mounting` has them, `command` sends it; `walk_around`
checks the mounting with the help of a person. Only `command` opens links and reads a clock.
"""
