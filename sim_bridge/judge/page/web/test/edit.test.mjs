import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";
import { EDIT_LAYERS, EditMap } from "../edit/editmap.js";
import { Client } from "../edit/client.js";
import { textOf } from "../edit/flying.js";
import { addStop, fenceAround, fenceOf, heightFor, moveTo, nearestTree, pointsOf, removeStop, ringSpots, setFence, subjectOf, treesInTheWay, withVertex } from "../edit/plan.js";
import { coordinates, diskText, hintOf, readValue, savedText, shownValue, treeText, verdictOf } from "../edit/words.js";
import { fakeCanvas, setUpBrowser } from "./kit.mjs";

beforeEach(setUpBrowser);

const VALUES = {
  route: { d1_enu_m: [0, 0, 4], d2_enu_m: [100, 0, 5], d2_tree: "A-1", stops: [{ pos_enu_m: [50, 20, 4] }] },
  fence: { polygon_enu_m: [[-20, -20], [120, -20], [120, 40], [-20, 40]] },
};
const TREES = { east_m: [10, 100, 50], north_m: [0, 0.5, 60], radius_m: [0.2, 0.3, 0.1], height_m: [20, 25, 9], crown_base_m: [9, 9, 9], crown_radius_m: [2, 2, 2], id: ["", "A-1", ""], species: ["", "spruce", ""] };
const STAND = { trees: TREES, bushes: { east_m: [], north_m: [], radius_m: [], height_m: [] }, boxes: [], grade: [0.1, 0] };
const FIELDS = { "coverage.radius_m": 15, "coverage.keep_out_m": 2, "swarm.size": 4, "radio.transit_range_m": 30, "radio.full_range_m": 55, "route.at_end": "return" };
const STATE = { values: VALUES, fields: FIELDS, start: { radius_m: 9, clear_m: 10.5 }, attenuation: 0.5, problems: [], beyond: [] };

test("points are in the order of the flight, with the keys that refusals have", () => {
  const points = pointsOf(VALUES);
  assert.deepEqual(points.map(({ name }) => name), ["d1", "stop 1", "d2"]);
  assert.deepEqual(points[1].path, ["route", "stops", 0, "pos_enu_m"]);
  assert.equal(points[1].key, "route.stops[0].pos_enu_m");
});

test("values that are missing or malformed are points that are not there, and harm nothing", () => {
  for (const values of [{}, { route: null }, { route: { d1_enu_m: "here", d2_enu_m: [1, 2], stops: "none" } }, { route: { stops: [null, {}, { pos_enu_m: [1, NaN, 2] }] } }]) {
    assert.ok(pointsOf(values).every(({ enu }) => enu === null));
  }
  assert.deepEqual(fenceOf({ fence: { polygon_enu_m: [[1, 2], "x", [3]] } }), [[1, 2]]);
  assert.deepEqual(fenceOf({}), []);
});

test("a point that is moved keeps its height, and is not named by its tree any more", () => {
  const [d1, , d2] = pointsOf(VALUES);
  assert.deepEqual(moveTo(VALUES, d1, [1.234, -5.678], 8), [{ do: "set", path: ["route", "d1_enu_m"], value: [1.2, -5.7, 4] }]);
  assert.deepEqual(moveTo(VALUES, d2, [90.123, 4.567], 8, 2), [
    { do: "set", path: ["route", "d2_enu_m"], value: [90.12, 4.57, 5] },
    { do: "remove", path: ["route", "d2_tree"] },
  ]);
});

test("a new point is as high as the others, or as the server proposes", () => {
  assert.equal(heightFor(VALUES, 8), 4);
  assert.equal(heightFor({}, 8), 8);
  const [d1] = pointsOf({});
  assert.deepEqual(moveTo({}, d1, [0, 0], 4.4)[0].value, [0, 0, 4.4]);
});

test("a stop is put where the way grows least by it", () => {
  const at = (east, north) => addStop(VALUES, [east, north], 8)[0].path[2];
  assert.equal(at(20, 8), 0);
  assert.equal(at(80, 8), 1);
  assert.deepEqual(addStop({}, [1, 2], 8), [{ do: "insert", path: ["route", "stops", 0], value: { pos_enu_m: [1, 2, 8] } }]);
  assert.deepEqual(removeStop(1), [{ do: "remove", path: ["route", "stops", 1] }]);
});

test("a corner goes into the side that it is nearest to, and without corners there is no fence", () => {
  const polygon = fenceOf(VALUES);
  assert.equal(withVertex(polygon, [130, 10]).findIndex(([e]) => e === 130), 2);
  assert.deepEqual(withVertex([[0, 0], [1, 0]], [5, 5]), [[0, 0], [1, 0], [5, 5]]);
  const full = Array.from({ length: 64 }, (_, k) => [k, 0]);
  assert.equal(withVertex(full, [1, 1]), full);
  assert.deepEqual(setFence([]), [{ do: "remove", path: ["fence", "polygon_enu_m"] }]);
  assert.deepEqual(setFence([[0.04, 1.06]])[0].value, [[0, 1.1]]);
});

test("a fence around all leaves room for starting places and ring, with slack", () => {
  const [[west, south], , [east, north]] = fenceAround(pointsOf(VALUES), { start: 9, ring: 15 });
  assert.ok(west <= -9 - 5 && south <= -15 - 5 && east >= 115 + 5 && north >= 35 + 5, [west, south, east, north].join());
  assert.deepEqual(fenceAround(pointsOf({}), { start: 9, ring: 15 }), []);
});

test("the ideal ring has its vehicles evenly spread, the first where they come from", () => {
  const spots = ringSpots([100, 0], 10, 4, [0, 0]);
  assert.ok(Math.hypot(spots[0][0] - 90, spots[0][1]) < 1e-9);
  const gaps = spots.map(([e, n], k) => Math.hypot(e - spots[(k + 1) % 4][0], n - spots[(k + 1) % 4][1]));
  assert.ok(gaps.every((gap) => Math.abs(gap - 10 * Math.SQRT2) < 1e-9));
  assert.equal(ringSpots([0, 0], 10, 1e9).length, 250);
});

test("a click near a tree means the tree, and trees in the starting places are found", () => {
  assert.equal(nearestTree(TREES, [99, 0], 2), 1);
  assert.equal(nearestTree(TREES, [90, 0], 2), null);
  assert.deepEqual(treesInTheWay(TREES, [0, 0], 9.9), [0]);
  assert.deepEqual(treesInTheWay(TREES, [0, 0], 9.7), []);
});

test("a refusal is shown where it belongs", () => {
  const fields = new Set(Object.keys(FIELDS));
  const subjects = {
    "swarm.size": { field: "swarm.size" },
    "fence.polygon_enu_m": { fence: true },
    "fence.polygon_enu_m[2][0]": { fence: true },
    "route.stops[1].pos_enu_m[0]": { point: "stop 2" },
    "route.d1_enu_m[2]": { point: "d1" },
    "route.d2_tree": { point: "d2" },
    "forest.file": { stems: true },
    "the tree at -3.00 east, 2.50 north": { tree: [-3, 2.5] },
    "sim.faults[0]": null,
    "": null,
  };
  for (const [key, subject] of Object.entries(subjects)) assert.deepEqual(subjectOf(key, fields), subject, key);
});

test("coordinates are metres, and latitude and longitude where it is known where that is", () => {
  assert.equal(coordinates([-0.01, 12.34], null), "0.0 m east, 12.3 m north");
  assert.match(coordinates([0, 0], { lat_deg: 47.5, lon_deg: 8.25 }), /· 47\.500000, 8\.250000$/);
  assert.equal(treeText(TREES, 1), "A-1, spruce, 60 cm, 25 m tall");
  assert.equal(treeText(TREES, 0), "tree, 40 cm, 20 m tall");
});

test("fields show numbers as they are, and read commas too", () => {
  assert.deepEqual([null, undefined, 4, 4.1000000001, "ring"].map(shownValue), ["", "", "4", "4.1", "ring"]);
  assert.deepEqual(readValue("number", " 3,5 "), { value: 3.5 });
  assert.deepEqual([readValue("number", ""), readValue("number", "x"), readValue("string", "")], [{ empty: true }, { wrong: true }, { value: "" }]);
});

test("the page says in words how things stand", () => {
  assert.deepEqual(verdictOf({ problems: [1, 2], beyond: [] }), { good: false, text: "Does not check: 2 problems" });
  assert.equal(verdictOf({ problems: [1], beyond: [] }).text, "Does not check: 1 problem");
  assert.deepEqual(verdictOf(STATE), { good: true, text: "Checks" });
  assert.equal(savedText({ is_saved: false, disk: "new" }), "new, not saved yet");
  assert.match(diskText({ disk: "changed", file: "my.toml" }), /^my\.toml was changed/);
  assert.equal(diskText({ disk: "same" }), "");
  assert.match(hintOf("move", pointsOf({}), []), /^Choose d1/);
  assert.match(hintOf("fence", pointsOf(VALUES), [[0, 0]]), /2 more/);
  const flight = { lines: ["  3 s  x"], revision: 1, is_under_way: true, code: null };
  assert.equal(textOf(flight, 1), "Flying in point masses: 3 s  x");
  assert.match(textOf({ ...flight, is_under_way: false, code: 2, lines: [] }, 2), /^sim-bridge ended with code 2 \(of the mission before/);
});

// --- The map ------------------------------------------------------------------------------------------------------------

function editMap() {
  const heard = {};
  const canvas = { ...fakeCanvas(400, 300), dataset: {}, matches: () => true };
  canvas.addEventListener = (kind, act) => (heard[kind] ??= []).push(act);
  const done = [];
  const acts = Object.fromEntries(["placed", "moved", "chosen", "removed", "hovered"].map((name) => [name, (...given) => done.push([name, ...given])]));
  const map = new EditMap(canvas, acts);
  map.resized();
  map.update(STATE, STAND);
  const fire = (kind, more) => heard[kind].forEach((act) => act({ pointerId: 1, preventDefault() {}, stopPropagation() {}, stopImmediatePropagation() {}, ...more }));
  const at = ([e, n]) => ({ offsetX: map.x(e), offsetY: map.y(n) });
  return { map, done: () => done.filter(([name]) => name !== "hovered"), fire, at };
}

test("every layer is drawn, with data and without", () => {
  const { map } = editMap();
  assert.equal(new Set(EDIT_LAYERS.map(({ name }) => name)).size, EDIT_LAYERS.length);
  assert.ok(map.canvas.ctx.calls.length > 100);
  map.use("d1");
  map.update({ ...STATE, values: {}, start: null }, null);
  map.fit();
});

test("a handle is dragged, and the ground is not", () => {
  const { map, done, fire, at } = editMap();
  const { east } = map.view;
  fire("pointerdown", at([100, 0]));
  fire("pointermove", at([90, 10]));
  assert.deepEqual(map.plan().points[2].enu.map(Math.round), [90, 10, 5]);
  assert.deepEqual(map.plan().rings[1].at.map(Math.round), [90, 10, 5]);
  fire("pointerup", at([90, 10]));
  assert.equal(map.view.east, east);
  const [[, first], [name, handle, where]] = done();
  assert.deepEqual([first, name, handle, where.map(Math.round)], [{ point: "d2" }, "moved", { point: "d2" }, [90, 10]]);
  fire("pointerdown", at([50, -10]));
  fire("pointermove", at([60, -10]));
  fire("pointerup", at([60, -10]));
  assert.ok(Math.abs(map.view.east - (east - 10)) < 1e-6);
});

test("a drag that is broken off changes nothing", () => {
  const { map, done, fire, at } = editMap();
  fire("pointerdown", at([0, 0]));
  fire("pointermove", at([30, 30]));
  fire("pointercancel", at([30, 30]));
  assert.deepEqual(done().map(([name]) => name), ["chosen"]);
  assert.deepEqual(map.plan().points[0].enu, [0, 0, 4]);
});

test("a tap places what the tool is for; a corner is chosen whatever the tool", () => {
  const { map, done, fire, at } = editMap();
  const tap = (where) => ["pointerdown", "pointerup"].forEach((kind) => fire(kind, at(where)));
  map.use("stop");
  tap([30, -15]);
  const [name, tool, where] = done().at(-1);
  assert.deepEqual([name, tool, where.map(Math.round)], ["placed", "stop", [30, -15]]);
  map.use("fence");
  tap([120, 40]);
  assert.deepEqual(done().at(-1), ["chosen", { corner: 2 }]);
});

test("keys place at the cross, remove what is chosen, and leave the rest to the map", () => {
  const { map, done, fire } = editMap();
  fire("keydown", { key: "Enter" });
  assert.deepEqual(done(), []);
  map.use("d1");
  fire("focus", {});
  assert.ok(map.plan().aims);
  fire("keydown", { key: "Enter" });
  assert.deepEqual(done().at(-1), ["placed", "d1", [map.view.east, map.view.north]]);
  map.selected = { corner: 1 };
  fire("keydown", { key: "Delete" });
  assert.deepEqual(done().at(-1), ["removed", { corner: 1 }]);
  const { scale } = map.view;
  fire("keydown", { key: "+" });
  assert.ok(map.view.scale > scale);
});

// --- The server ---------------------------------------------------------------------------------------------------------

function answering(...answers) {
  const asked = [];
  globalThis.fetch = async (path, options) => {
    asked.push([path, options.body && JSON.parse(options.body)]);
    const { ok = true, type = "application/json", body } = answers.shift();
    return { ok, headers: { get: () => type }, json: async () => body, text: async () => String(body) };
  };
  return asked;
}

test("each request is of the text that the one before left", async () => {
  const asked = answering({ body: { revision: 1 } }, { body: { state: { revision: 2 } } }, { body: { state: { revision: 3 } } });
  const shown = [];
  const client = new Client((state) => shown.push(state.revision), assert.fail);
  client.look("/state");
  client.do("/change", { changes: [1] });
  await client.do("/change", () => ({ changes: [2] }));
  assert.deepEqual(shown, [3]); // those before would be written over what is being typed
  assert.deepEqual(asked.map(([, body]) => body?.revision), [undefined, 1, 2]);
});

test("what was answered is shown though the request behind it comes to nothing", async () => {
  answering({ body: { revision: 1 } }, { ok: false, type: "text/plain", body: "no" });
  const shown = [];
  const client = new Client((state) => shown.push(state.revision), () => {});
  client.look("/state");
  client.do("/save");
  await client.do("/change", () => null);
  assert.deepEqual(shown, [1]);
});

test("a refusal is said, and shows how it stands; so is a server that is gone", async () => {
  answering({ body: { revision: 1 } }, { ok: false, body: { refused: "no", state: { revision: 5 } } }, { ok: false, type: "text/plain", body: "Only the page\n" });
  const failed = [];
  const client = new Client(() => {}, (text) => failed.push(text));
  await client.look("/state");
  assert.equal(await client.do("/change", { changes: [1] }), null);
  assert.equal(client.state.revision, 5);
  await client.do("/save");
  globalThis.fetch = async () => {
    throw new Error("refused");
  };
  await client.do("/save");
  assert.deepEqual([failed[0], failed[1]], ["no", "Only the page"]);
  assert.match(failed[2], /is it still running/);
});
