"""The tables of our own messages: one row is one field; everything else about it is generated (`make dialect`)."""
