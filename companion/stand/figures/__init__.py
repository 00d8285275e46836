"""Figures of a stand, per hectare of the ground that was seen, with intervals of 95 %.

`ground` finds which places were in sight of which vehicle, when and how near, and what trunks hid; `detection` how
likely a stem there was found; `estimate` weighs stems by that, and tells the intervals.
"""
