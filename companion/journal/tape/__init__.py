"""Answers from outside the endpoint's inputs: of a guard with keys, a signed link, a link of records, the orders' disk.

They depend on a key, a disk or a random number. While a flight is recorded they are put on a `tape` in the order in
which the endpoint asks (`recorded`); a replay plays them back to the same questions (`played`), and needs neither key
nor disk.
"""
