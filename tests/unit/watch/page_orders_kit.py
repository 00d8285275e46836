"""Orders as the page sends them, made by another code than the server's: `hmac` over the text that the docs give."""

from __future__ import annotations

import hashlib
import hmac
import json

from companion.watch.orders.order_key import OrderKey

SIZE = 4


def mac_of(key: str, text: str) -> str:
    return hmac.new(key.encode(), text.encode(), hashlib.sha256).hexdigest()


def key_of(key: OrderKey) -> str:
    return key.fragment.removeprefix("orders=")


def body(key: str, nonce: str, kind: str = "HOLD", **changes: object) -> bytes:
    """Signed with these fields; a field of `changes` named `then_...` is changed after that."""
    later = {name.removeprefix("then_"): value for name, value in changes.items() if name.startswith("then_")}
    said: dict[str, object] = {"kind": kind, "hand_back": 0, "without": [], "nonce": nonce}
    said |= {name: value for name, value in changes.items() if not name.startswith("then_")}
    without = ",".join(map(str, said["without"]))  # type: ignore[call-overload]
    text = f"understory order 1\n{said['nonce']}\n{said['kind']}\n{said['hand_back']}\n{without}"
    return json.dumps({**said, "mac": mac_of(key, text), **later}).encode()
