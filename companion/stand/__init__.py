"""A stand from the records of many vehicles: stems fused, figures with intervals, files and a report.

In this order: `records` reads and decodes; `fusion` makes stems of observations; `figures` finds the ground that was
seen and what grows per hectare of it; `products` writes what foresters open; `command` is `companion stand`.
"""
