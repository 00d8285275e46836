"""Movement laws of others, as their papers give them, to compare ours with; and the tuning of all of them."""
