"""Names of `cryptography`, which has no build for a browser here: the page's swarm has no keys."""


class Absent:
    """Stands for what signs, verifies or derives."""

    def __init__(self, *_: object, **__: object) -> None:
        raise NotImplementedError("the page has no cryptography: its swarm flies without keys")

    from_private_bytes = from_public_bytes = __init__
