"""A mission as a whole: the checked model, a file read and written, and what a simulator asks of it."""
