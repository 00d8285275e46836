import assert from "node:assert/strict";
import { createHmac } from "node:crypto";
import { mock, test } from "node:test";
import { Hold, HOLD_MS } from "../watch/orders/hold.js";
import { isRight, macOf, proven, takeKey, textOf } from "../watch/orders/orderkey.js";
import { send } from "../watch/orders/send.js";
import { Settled, progressOf, questionOf, releasedOf } from "../watch/orders/words.js";

const KEY = "0123456789abcdef0123456789abcdef";
const hmacOf = (text) => createHmac("sha256", KEY).update(text).digest("hex"); // another implementation's

function tab(hash) {
  const kept = new Map();
  const said = [];
  return {
    said,
    location: { hash, pathname: "/", search: "?a" },
    history: { replaceState: (...given) => said.push(given[2]) },
    storage: { setItem: (name, value) => kept.set(name, value), getItem: (name) => kept.get(name) ?? null },
  };
}

test("the key is taken out of the address, and kept for this tab", () => {
  const one = tab(`#orders=${KEY}`);
  assert.equal(takeKey(one), KEY);
  assert.deepEqual(one.said, ["/?a"]);
  one.location.hash = "";
  assert.equal(takeKey(one), KEY); // loaded again
  for (const hash of ["", "#orders=", `#orders=${KEY}0`, "#orders=zz", `#other=${KEY}`]) assert.equal(takeKey(tab(hash)), null);
});

test("without a storage the key holds as long as the page", () => {
  const closed = () => {
    throw new Error("closed");
  };
  const one = { ...tab(`#orders=${KEY}`), storage: { setItem: closed, getItem: closed } };
  assert.equal(takeKey(one), KEY);
  assert.deepEqual(one.said, ["/?a"]);
  one.location.hash = "";
  assert.equal(takeKey(one), null);
});

test("a MAC is HMAC-SHA256 of every field, as another implementation makes it", () => {
  const order = proven({ kind: "START", without: [3, 12], hand_back: 2 }, "ab12", KEY);
  assert.equal(order.mac, hmacOf("understory order 1\nab12\nSTART\n2\n3,12"));
  const { mac, ...rest } = order;
  assert.deepEqual(rest, { kind: "START", hand_back: 2, without: [3, 12], nonce: "ab12" });
  for (const changed of [{ kind: "HOLD" }, { hand_back: 0 }, { without: [3] }, { nonce: "ab13" }]) assert.notEqual(macOf(KEY, textOf({ ...rest, ...changed })), mac);
  assert.deepEqual(proven({ kind: "HOLD" }, "ab", KEY).without, []);
});

test("a page knows whether its key is the server's", () => {
  const orders = { check: hmacOf("understory order 1 check") };
  assert.equal(isRight(KEY, orders), true);
  assert.equal(isRight(KEY.replace("0", "1"), orders), false);
  assert.equal(isRight(null, orders), false);
});

// A server that answers these in turn, and what it was sent.
function server(...answers) {
  const sent = [];
  return { sent, by: (order) => (sent.push(order), answers.shift()) };
}
const options = (by) => ({ key: KEY, nonce: () => "aa", by });

test("an order whose nonce is over is sent again with the one that the refusal gives", async () => {
  const { sent, by } = server({ status: 409, why: "old", nonce: "bb" }, { status: 200 });
  assert.equal(await send({ kind: "START", without: [2] }, options(by)), "");
  assert.deepEqual(sent.map(({ nonce, without }) => [nonce, without]), [["aa", [2]], ["bb", [2]]]);
  assert.equal(sent[1].mac, hmacOf("understory order 1\nbb\nSTART\n0\n2"));
});

test("an order without an answer is sent again, but for a START", async () => {
  const silent = { status: 0, why: "no answer", nonce: null };
  for (const [kind, times] of [["ABORT", 3], ["LAND", 3], ["HOLD", 3], ["START", 1]]) {
    const { sent, by } = server(silent, silent, silent);
    assert.equal(await send({ kind }, options(by)), "no answer");
    assert.equal(sent.length, times, kind);
  }
});

test("an order that is refused is not sent again, and why is told", async () => {
  for (const status of [400, 403, 412, 429, 500, 503]) {
    const { sent, by } = server({ status, why: status === 429 ? "" : "why", nonce: "bb" });
    assert.equal(await send({ kind: "HOLD" }, options(by)), status === 429 ? "refused (429)" : "why");
    assert.equal(sent.length, 1);
  }
});

test("a page that no picture has reached yet gets a nonce by being refused", async () => {
  const { sent, by } = server({ status: 409, why: "old", nonce: "bb" }, { status: 200 });
  assert.equal(await send({ kind: "ABORT" }, { ...options(by), nonce: () => null }), "");
  assert.deepEqual(sent.map(({ nonce }) => nonce), ["0".repeat(24), "bb"]);
});

test("a start says who is ready and who is missing and why, and names those that stay", () => {
  const question = questionOf("START", { ready: [1, 4], missing: { 3: "not heard", 2: "waiting" } });
  assert.deepEqual(question.lines, ["Ready, or in the air: 1, 4", "Vehicle 2: waiting", "Vehicle 3: not heard"]);
  assert.equal(question.confirm, "Start 2 of 4, without 2, 3");
  assert.deepEqual(question.order, { kind: "START", without: [2, 3], hand_back: 0 });
  const back = questionOf("START", { ready: [1, 2], missing: {} }, 2);
  assert.equal(back.confirm, "Start 2 of 2, and hand back 2");
  assert.equal(back.order.hand_back, 2);
  assert.equal(questionOf("START", { ready: [], missing: { 1: "not heard" } }).order, null);
  assert.deepEqual(questionOf("START", { ready: [], missing: { 1: "landed" } }).order.without, [1]); // the server decides
});

test("hold, land and abort are asked about in a sentence", () => {
  for (const kind of ["HOLD", "LAND", "ABORT"]) {
    const { lines, order } = questionOf(kind, null);
    assert.ok(lines[0].toUpperCase().startsWith(`${kind}?`));
    assert.deepEqual(order, { kind });
  }
});

test("progress names who acts on it, who does not, and who is not heard", () => {
  const sent = { kind: "HOLD", acting: [1, 2], aborted: [], waits_for: [4], not_heard: [3] };
  assert.deepEqual(progressOf(sent), ["HOLD: acting on it: 1, 2", "HOLD: heard, and not acting on it: 4", "Not heard: 3"]);
  assert.deepEqual(progressOf({ kind: "ABORT", acting: [], aborted: [], waits_for: [], not_heard: [] }), ["ABORT: nobody is heard to act on it"]);
  assert.deepEqual(progressOf(null), []);
});

test("a land behind an abort is told as the abort that stays", () => {
  const sent = { kind: "LAND", acting: [], aborted: [1, 2], waits_for: [], not_heard: [] };
  assert.deepEqual(progressOf(sent), ["LAND: ABORT stays in force, which is above it: 1, 2"]);
  const some = { ...sent, acting: [3], aborted: [1] };
  assert.deepEqual(progressOf(some), ["LAND: ABORT stays in force, which is above it: 1", "LAND: acting on it: 3"]);
});

test("only a vehicle that a pilot has is handed back", () => {
  assert.deepEqual(releasedOf([{ id: 1, state: "transit" }, { id: 2, state: "released" }]), [2]);
});

test("a button whose words have changed waits until they can be read", () => {
  const settled = new Settled(1000);
  assert.deepEqual([settled.isSo("a", 0), settled.isSo("a", 999), settled.isSo("a", 1000)], [false, false, true]);
  assert.deepEqual([settled.isSo("b", 1100), settled.isSo("b", 2099), settled.isSo("b", 2100)], [false, false, true]);
});

function button() {
  const node = new EventTarget();
  const classes = new Set();
  node.classList = { add: (name) => classes.add(name), remove: (name) => classes.delete(name) };
  node.setPointerCapture = () => {};
  const events = [];
  const hold = new Hold(node, { held: () => events.push("held"), tapped: () => events.push("tapped") });
  const fire = (name, more = {}) => node.dispatchEvent(Object.assign(new Event(name, { cancelable: true }), { isPrimary: true, button: 0, detail: 1, ...more }));
  return { hold, classes, events, fire };
}

test("a long press acts once, and its click asks nothing", () => {
  mock.timers.enable({ apis: ["setTimeout"] });
  const { classes, events, fire } = button();
  fire("pointerdown");
  mock.timers.tick(HOLD_MS - 1);
  assert.deepEqual([events, classes.has("held")], [[], true]);
  mock.timers.tick(1);
  fire("pointerup");
  fire("click");
  mock.timers.tick(10 * HOLD_MS);
  assert.deepEqual([events, classes.has("held")], [["held"], false]);
  mock.timers.reset();
});

test("a press that ends too soon asks, and so do keys", () => {
  for (const ending of ["pointerup", "pointercancel", "lostpointercapture"]) {
    mock.timers.enable({ apis: ["setTimeout"] });
    const { events, fire } = button();
    fire("pointerdown");
    mock.timers.tick(HOLD_MS - 1);
    fire(ending);
    mock.timers.tick(10 * HOLD_MS);
    assert.deepEqual(events, [], ending);
    fire("click");
    assert.deepEqual(events, ["tapped"]);
    mock.timers.reset();
  }
  mock.timers.enable({ apis: ["setTimeout"] });
  const { events, fire } = button();
  fire("pointerdown");
  mock.timers.tick(HOLD_MS);
  fire("click", { detail: 0 }); // a key, or a screen reader
  fire("pointerdown", { button: 2 });
  fire("pointerdown", { isPrimary: false });
  mock.timers.tick(HOLD_MS);
  assert.deepEqual(events, ["held", "tapped"]);
  mock.timers.reset();
});
