"""Orders of the operator's key: made and read (`order`), picked from a flood (`candidates`), obeyed (`book`)."""
