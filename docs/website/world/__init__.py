"""A flight of point masses in one process, as the page flies it, and what the page draws of it."""
