"""The tables of a mission file: each key once, from which come the model, the check and the JSON Schema."""
