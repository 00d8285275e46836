"""Many flights: studies, laws beside ours, the paper reproduced."""
