// The key of orders: from the address's fragment, which no browser sends, into this tab. It proves orders; it is never sent.
// Over plain HTTP browsers have no crypto.subtle: HMAC-SHA256 is of @noble/hashes.
import { hmac } from "@noble/hashes/hmac.js";
import { sha256 } from "@noble/hashes/sha2.js";
import { bytesToHex, utf8ToBytes } from "@noble/hashes/utils.js";

const FRAGMENT = /^#orders=([0-9a-f]{32})$/; // as companion/watch/orders/order_key.py
const CHECK = "understory order 1 check";
const KEPT = "understory-orders";

// Out of the address bar and its history; kept for this tab alone, so that the page may be loaded again.
export function takeKey({ location, history, storage }) {
  const found = FRAGMENT.exec(location.hash)?.[1] ?? null;
  try {
    if (found) storage.setItem(KEPT, found);
    else return storage.getItem(KEPT);
  } catch {
    // storage may be closed: this page alone, then
  }
  if (found) history.replaceState(null, "", location.pathname + location.search);
  return found;
}

export const macOf = (key, text) => bytesToHex(hmac(sha256, utf8ToBytes(key), utf8ToBytes(text)));

// The server's key is this one: it gives its own MAC of the same words.
export const isRight = (key, orders) => key !== null && macOf(key, CHECK) === orders.check;

// As companion/watch/orders/page_order.py: all of an order but its MAC.
export const textOf = ({ nonce, kind, hand_back: back, without }) => `understory order 1\n${nonce}\n${kind}\n${back}\n${without.join(",")}`;

export function proven(order, nonce, key) {
  const whole = { kind: order.kind, hand_back: order.hand_back ?? 0, without: order.without ?? [], nonce };
  return { ...whole, mac: macOf(key, textOf(whole)) };
}
