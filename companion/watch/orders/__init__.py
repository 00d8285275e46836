"""Orders from the page of `companion watch`: read, proven by a key and a nonce, taken by the server, and sent."""
