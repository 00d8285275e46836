"""Black box: every input and output of an endpoint, in a chained MCAP log; replay runs it again and compares bits.

`recorder` stands before the endpoint, `tape` beside what it asks, `journal` makes chunks, `segments` files; `reading`,
`rebuild` and `replay` go the way back.
"""
