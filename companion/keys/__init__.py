"""Keys of a fleet: what a keyring holds (`keyring`), and what is derived, signed and checked with it (`crypto`)."""
