"""A world that moves when every companion has answered, in this process or as processes."""
