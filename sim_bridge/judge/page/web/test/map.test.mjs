import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";
import { FLIGHT_LAYERS, FlightMap } from "../src/map/flightmap.js";
import { FLIGHT_KEYS, WATCH_KEYS, checked, legendOf } from "../src/map/layer.js";
import * as registry from "../src/map/layers/index.js";
import { Replay } from "../src/replay.js";
import { WATCH_LAYERS, WatchMap } from "../watch/watchmap.js";
import { fakeCanvas, fakeContext, flightDocument, setUpBrowser } from "./kit.mjs";

beforeEach(setUpBrowser);

function flightMap(shown = {}) {
  const found = [];
  const map = new FlightMap(fakeCanvas(), new Replay(flightDocument()), shown, (hit) => found.push(hit));
  map.resized();
  return { map, found };
}

function dummy(more = {}) {
  const drawn = [];
  return { drawn, layer: { name: "dummy", needs: ["replay"], draw: (ctx, view, data) => drawn.push({ ctx, view, data }), ...more } };
}

test("a layer that is registered is drawn, with the view and the data of its page", () => {
  const { map } = flightMap();
  const { drawn, layer } = dummy();
  map.register(layer);
  map.show(1);
  assert.equal(drawn.length, 1);
  assert.equal(drawn[0].ctx, map.canvas.ctx);
  assert.equal(drawn[0].view, map.view);
  assert.equal(drawn[0].data.at.row, 1);
  assert.equal(drawn[0].data.ink.alarm, "--alarm");
});

test("a layer that is switched off, or without its data, is not drawn", () => {
  const { map } = flightMap({ dummy: false });
  const off = dummy();
  const without = dummy({ name: "without", needs: ["chart"] });
  map.register(off.layer);
  map.register(without.layer);
  map.show(1);
  assert.deepEqual([off.drawn.length, without.drawn.length], [0, 0]);
  map.shown.dummy = true;
  map.show(1);
  assert.equal(off.drawn.length, 1);
});

test("a layer that stands still is drawn again when the view changes, and not for each frame", () => {
  const { map } = flightMap();
  const { drawn, layer } = dummy({ still: true });
  map.register(layer);
  map.show(1);
  map.show(2);
  assert.equal(drawn.length, 1);
  map.zoom(2);
  assert.equal(drawn.length, 2);
});

test("the uppermost layer that is hit tells what is there", () => {
  const { map, found } = flightMap();
  map.register(dummy({ hit: (view, data, px) => (px < 5 ? "dummy" : null) }).layer);
  map.show(0);
  map.pick(map.x(30), map.y(0));
  map.pick(0, 0);
  map.pick(map.x(15), map.y(0) + 40);
  assert.deepEqual(found, [1, "dummy", null]);
});

test("boxes are outlined where their corners are", () => {
  const { map } = flightMap();
  const ctx = fakeContext();
  registry.boxes.draw(ctx, map.view, { ink: {}, replay: new Replay(flightDocument()) });
  const corners = ctx.calls.filter(([name]) => name === "lineTo").map(([, x, y]) => [x, y]);
  assert.deepEqual(corners, [[10, 4], [20, 4], [20, 8], [10, 8]].map(([e, n]) => [map.view.x(e), map.view.y(n)]));
  assert.deepEqual(new Replay({ ...flightDocument(), stand: { ...flightDocument().stand, boxes_enu_m: undefined } }).boxes, []);
});

test("a layer of a name that is there already, or of another shape, is refused", () => {
  const { map } = flightMap();
  assert.throws(() => map.register(registry.grid), /layer grid: there is one/);
  assert.throws(() => checked({ ...dummy().layer, drow: 1 }), /layer dummy: drow is no part/);
  assert.throws(() => checked({ name: "empty" }), /layer empty: name, needs, draw/);
});

test("every layer bears the name that it is exported by, and is on a page that has its data", () => {
  for (const [name, layer] of Object.entries(registry)) {
    assert.equal(checked(layer).name, name);
    assert.ok(FLIGHT_LAYERS.includes(layer) || WATCH_LAYERS.includes(layer), `${name} is on no page`);
  }
  for (const [layers, keys] of [[FLIGHT_LAYERS, FLIGHT_KEYS], [WATCH_LAYERS, WATCH_KEYS]]) {
    for (const { name, needs } of layers) for (const key of needs) assert.ok(keys.includes(key), `${name} needs ${key}`);
  }
});

test("the legend has a switch for each layer that has something to show, in their order", () => {
  const few = (name, order, has) => dummy({ name, legend: { text: name, order, shown: true, has } }).layer;
  const layers = [few("second", 2), few("swarms", 3, (replay) => replay.vehicles.length > 1), few("first", 1), registry.grid];
  const names = (replay) => legendOf(layers, [{ name: "follow", order: 9 }], replay).map(({ name }) => name);
  const replay = new Replay(flightDocument());
  assert.deepEqual(names(replay), ["first", "second", "swarms", "follow"]);
  replay.vehicles.length = 1;
  assert.deepEqual(names(replay), ["first", "second", "follow"]);
});

test("a map that follows the swarm keeps its middle in the middle", () => {
  const { map } = flightMap({ follow: true });
  map.show(1);
  assert.deepEqual([map.view.east, map.view.north], [20, 0]); // of 10 and 30 m east
});

test("a flight without a row yet has its map, and no vehicles", () => {
  const replay = new Replay({ ...flightDocument(), time_s: { order: 0, step: 1, is: [] } });
  const map = new FlightMap(fakeCanvas(), replay, {}, () => {});
  map.resized();
  assert.deepEqual(map.canvas.ctx.calls.filter(([name, text]) => name === "fillText" && /leads/.test(text)), []);
  assert.ok(map.canvas.ctx.calls.some(([name, text]) => name === "fillText" && text === "d2"));
});

test("a window of another size shows all again, but not after its reader has moved the map", () => {
  const { map } = flightMap();
  const { scale } = map.view;
  [map.canvas.clientWidth, map.canvas.clientHeight] = [400, 200];
  map.resized();
  assert.ok(map.view.scale > scale);
  map.pan(30, 0);
  const { east } = map.view;
  [map.canvas.clientWidth, map.canvas.clientHeight] = [100, 50];
  map.resized();
  assert.deepEqual([map.view.east, map.view.width], [east, 100]);
});

test("the largest gap on the ring goes through north as through any other bearing", () => {
  const gapOf = (phase, angles) => {
    const document = flightDocument();
    document.swarm.phase.is = [phase];
    document.vehicles = angles.map((angle, k) => {
      const at = (value) => ({ order: 0, step: 1, is: [value, value, value] });
      const one = structuredClone(document.vehicles[0]);
      return { ...one, id: k + 1, east_m: at(40 + 10 * Math.cos(angle)), north_m: at(10 * Math.sin(angle)) };
    });
    const replay = new Replay(document);
    const ctx = fakeContext();
    const { view } = flightMap().map;
    registry.coverage.draw(ctx, view, { ink: {}, replay, at: { row: 0, share: 0 } });
    return ctx.calls.filter(([name]) => name === "fillText").map(([, text]) => text);
  };
  assert.deepEqual(gapOf(3, [0.5, 2, 3]), ["gap 217°"]); // 2π - 2.5
  assert.deepEqual(gapOf(2, [0.5, 2, 3]), []);
  assert.deepEqual(gapOf(3, [0.5]), []);
});

const PICTURE = {
  about: { mission: null, chart: null },
  vehicles: [
    { id: 1, age_s: 0.2, place: [47.4, 8.5], vel_ned_mps: [0, 0, 0], airborne: true, acting: true, leader: 1, parent: 0 },
    { id: 4, age_s: 9, place: null, reckoned: [47.401, 8.5], vel_ned_mps: [0, 0, 0], leader: 1, parent: 1, leader_sd_m: 2 },
  ],
  told: [{ id: 6, by: 4, age_s: 3, place: [47.4, 8.501] }],
};

test("the watched swarm's map draws its vehicles, says how old a ghost is, and finds who is picked", () => {
  const found = [];
  const map = new WatchMap(fakeCanvas(400, 400), (id) => found.push(id));
  map.resized();
  map.canvas.ctx.calls.length = 0;
  map.update(PICTURE);
  const texts = map.canvas.ctx.calls.filter(([name]) => name === "fillText").map(([, text]) => text);
  assert.deepEqual(texts.slice(0, 4), ["6, reported by 4", "1", "4", "9.0 s ago"]);
  const { enu } = map.data().vehicles[1];
  map.pick(map.x(enu[0]) + 10, map.y(enu[1]));
  assert.deepEqual(found, [4]);
});

test("the watched swarm's map follows its vehicles until somebody moves it", () => {
  const map = new WatchMap(fakeCanvas(400, 400), () => {});
  map.resized();
  map.update(PICTURE);
  const away = { ...PICTURE, vehicles: [{ ...PICTURE.vehicles[0], place: [47.41, 8.5] }] };
  map.update(away);
  assert.ok(map.holds(map.view));
  map.pan(2000, 0);
  map.update(PICTURE);
  assert.ok(!map.holds(map.view));
  map.follow();
  assert.ok(map.holds(map.view));
});
