"""As in `cryptography`."""


class InvalidSignature(Exception):  # noqa: N818
    """Nothing is verified here."""
