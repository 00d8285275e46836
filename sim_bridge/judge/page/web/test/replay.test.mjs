import assert from "node:assert/strict";
import { test } from "node:test";
import { deflateRawSync } from "node:zlib";
import { LiveReplay } from "../src/live.js";
import { Replay, unpack, upTo } from "../src/replay.js";
import { flightDocument } from "./kit.mjs";

test("a document is unpacked as it was packed", async () => {
  const packed = deflateRawSync(JSON.stringify({ a: [1, "ü"] })).toString("base64");
  assert.deepEqual(await unpack(`\n${packed}\n`), { a: [1, "ü"] });
});

test("columns are sums of their differences, in steps, with gaps", () => {
  const document = flightDocument();
  document.time_s = { order: 2, step: 0.5, is: [2, 0, 0] };
  document.swarm.separation_m = { order: 1, step: 0.1, is: [10, 5, 5], gaps: [1, 1] };
  const replay = new Replay(document);
  assert.deepEqual([...replay.time], [1, 2, 3]);
  assert.deepEqual([...replay.swarm.separation_m].map((value) => Number(value.toFixed(6))), [1, NaN, 2]);
});

test("what seldom changes holds until it changes", () => {
  const document = flightDocument();
  document.vehicles[0].leader = { rows: [0, 2], is: [1, 2], step: 1 };
  assert.deepEqual([...new Replay(document).vehicles[0].leader], [1, 1, 2]);
});

test("how many numbers are at most a value", () => {
  const sorted = [1, 2, 2, 5];
  assert.deepEqual([0, 1, 2, 4, 5, 9].map((value) => upTo(sorted, value)), [0, 1, 3, 3, 4, 4]);
});

test("a position between two rows is between theirs, and none is beyond the last", () => {
  const replay = new Replay(flightDocument());
  assert.deepEqual(replay.place(0, replay.at(0.25)), [2.5, 0, 8]);
  assert.deepEqual(replay.place(0, replay.at(99)), [20, 0, 8]);
  assert.deepEqual(replay.at(-1), { row: 0, share: 0 });
});

test("pairs are linked from one change to the next", () => {
  const document = flightDocument();
  document.links = [[1, 2, 1, 1]];
  const replay = new Replay(document);
  assert.deepEqual([0, 1, 2].map((row) => replay.linksAt(row).length), [0, 1, 0]);
  assert.deepEqual([...replay.swarm.links], [0, 1, 0]);
});

test("the points of a scan lie where its vehicle looked", () => {
  const document = flightDocument();
  document.vehicles[0].yaw_deg = { order: 0, step: 1, is: [0, 90, 90] };
  document.vehicles[0].scans = { rows: [1], sectors: 2, start_deg: 0, step_deg: 90, ranges_dm: [50, 0] };
  const replay = new Replay(document);
  assert.equal(replay.scanAt(0, 0), null);
  const { points, age } = replay.scanAt(0, 2);
  assert.equal(age, 1);
  assert.deepEqual(points.map((at) => at.map((value) => Math.round(value * 1e6) / 1e6)), [[15, 0]]);
});

test("trunk attenuation is read by its name until 0.2, too", () => {
  const document = flightDocument();
  delete document.mission.trunk_attenuation_factor;
  document.mission.kept_per_trunk = 0.7;
  assert.equal(new Replay(document).attenuationFactor, 0.7);
});

function sent(time, linked) {
  const links = Buffer.from([linked ? 0x80 : 0]).toString("base64");
  return { time_s: time, swarm: { leader: 1, phase: 2, separation_m: null }, vehicles: { east_m: [time, 30], north_m: [0, 0], up_m: [8, 8], leader: [1, 1] }, links };
}

test("a flight under way grows, and a row that is sent twice is taken once", () => {
  const replay = new LiveReplay(flightDocument());
  replay.add(sent(2, true));
  assert.equal(replay.end, 2);
  replay.add(sent(3, false));
  replay.add(sent(3, false));
  assert.deepEqual([...replay.time], [0, 1, 2, 3]);
  assert.deepEqual(replay.place(0, replay.at(3)), [3, 0, 8]);
  assert.deepEqual([0, 1, 2, 3].map((at) => replay.linksAt(at).length), [0, 1, 1, 0]);
  assert.ok(Number.isNaN(replay.swarm.separation_m[3]));
});

test("of a long flight the first rows are forgotten, and links stay as they were", () => {
  const replay = new LiveReplay(flightDocument());
  replay.most = 8;
  for (let time = 3; time < 40; time++) replay.add(sent(time, time % 3 > 0));
  assert.ok(replay.time.length <= replay.most);
  assert.equal(replay.end, 39);
  for (let at = 0; at < replay.time.length; at++) {
    assert.equal(replay.linksAt(at).length, replay.time[at] % 3 > 0 ? 1 : 0, `at ${replay.time[at]} s`);
  }
});
