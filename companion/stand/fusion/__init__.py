"""Observations of one stem by several vehicles, and on several passes, become one stem: `fuse`.

`windows` prepares them, `register` finds where a vehicle's frame lies, `associate` which observations are of one stem,
`adjustment` solves positions and frame errors together, `diameters` fuses what was measured across.
"""
