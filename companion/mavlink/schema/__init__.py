"""The schema of our own messages, and what is generated from it by `python -m companion.mavlink.schema`.

rows.py says what a row is, tables/ has the tables, messages.py gathers them; generate.py lists the files that are made
of them, each by a module named after it.
"""
