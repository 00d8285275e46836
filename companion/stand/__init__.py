"""A stand from the records of many vehicles: stems fused, figures with intervals, files and a report.

In this order: `records` reads and decodes; `fusion` makes stems of observations; `figures` finds the ground that was
seen and what grows per hectare of it; `products` writes what foresters open; `command` is `companion stand`. In flight,
`in_flight` is the child of a companion that leads: `summarise` makes its answer, `update` what the flight is told.
"""
