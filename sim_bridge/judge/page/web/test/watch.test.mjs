import assert from "node:assert/strict";
import { test } from "node:test";
import { Labels } from "../src/map/labels.js";
import { Silenced, keyOf, standing } from "../watch/alarms.js";
import { factsOf, peerReports, roleOf, unknown } from "../watch/panel.js";
import { age, aged, summaryOf } from "../watch/picture.js";
import { Plane, cornerOf, tileAt } from "../src/map/plane.js";
import { fakeContext } from "./kit.mjs";

const LOST = { kind: "link", vehicles: [3], text: "Vehicle 3: link lost, 4 s", grave: true };
const BATTERY = { kind: "battery", vehicles: [2], text: "Vehicle 2: battery", grave: false };

test("an alarm that is silenced stays silent while it stands, whatever its seconds, and sounds when it comes again", () => {
  const silenced = new Silenced();
  assert.deepEqual(silenced.loudOf([LOST, BATTERY]), [LOST]);
  silenced.silence([LOST, BATTERY]);
  assert.deepEqual(silenced.loudOf([{ ...LOST, text: "Vehicle 3: link lost, 5 s" }]), []);
  assert.deepEqual(silenced.loudOf([{ ...LOST, vehicles: [2] }]).map(keyOf), ["link 2"]);
  assert.deepEqual(silenced.loudOf([LOST]), [LOST]);
});

test("a computer that sends nothing is itself the first alarm", () => {
  assert.deepEqual(standing([LOST], 2.9), [LOST]);
  const [first, second] = standing([LOST], 3.1);
  assert.match(first.text, /^Link to the watching computer lost for 3\.1 s/);
  assert.deepEqual([first.grave, second], [true, LOST]);
});

test("ages have tenths while they are short, and go on while nothing comes", () => {
  assert.deepEqual([0.25, 9.94, 10, 99.4, 100, 3600].map(age), ["0.3 s", "9.9 s", "10 s", "99 s", "2 min", "60 min"]);
  const { vehicles, told } = aged({ vehicles: [{ age_s: 1 }], told: [{ age_s: 2 }] }, 0.5);
  assert.deepEqual([vehicles[0].age_s, told[0].age_s], [1.5, 2.5]);
});

const one = (id, more = {}) => ({ id, age_s: 0.1, phase: "transit", leader: 1, acting: id === 1, ...more });

test("a line says who leads, in which phase, and how many are heard", () => {
  assert.equal(summaryOf({ vehicles: [one(1), one(2)], silence_s: 0 }, 0), "Leader 1 · transit · 2 heard");
  assert.equal(summaryOf({ vehicles: [one(2), one(3, { age_s: 4 })], silence_s: 0 }, 0), "No leader · transit · 1 heard, 1 silent");
  assert.equal(summaryOf({ vehicles: [one(1, { age_s: 60 })], silence_s: 59 }, 1), "Nothing heard for 60 s");
  assert.equal(summaryOf({ vehicles: [], silence_s: null }, 1), "Nothing heard yet");
});

test("a card says what its vehicle does, or did", () => {
  assert.deepEqual([roleOf(one(1), true), roleOf(one(1), false)], ["leads", "led"]);
  assert.equal(roleOf(one(2, { acting: true }), true), "follows 1");
  assert.equal(roleOf(one(2, { leader: 0 }), true), "follows nobody");
  const facts = factsOf({ alt_m: 496, vel_ned_mps: [3, 4, 0], airborne: true, battery_percent: [60, 69] }, { ground_alt_m: 488 });
  assert.deepEqual(facts, ["in the air", "8 m up", "5.0 m/s", "battery 60 to 69 %"]);
});

test("what nobody knows is said", () => {
  const vehicles = [{ id: 1, place: [0, 0], battery_percent: null }];
  const lines = unknown({ about: { mission: { vehicles: 3, fence: [] } }, vehicles, not_heard: [2], refused: 4 }).join("\n");
  for (const words of [/Never received.*: 2\./, /never received or named: 3\./, /Battery.*: 1\./, /no fence/, /: 4\./]) assert.match(lines, words);
});

test("a place on the plane is where it was on the ellipsoid", () => {
  const plane = new Plane(47.4, 8.5);
  const [east, north] = plane.enu([47.401, 8.501]);
  assert.ok(Math.abs(north - 111.18) < 0.1 && Math.abs(east - 75.5) < 0.1, `${east}, ${north}`);
  const [lat, lon] = plane.wgs84([east, north]);
  assert.ok(Math.abs(lat - 47.401) < 1e-12 && Math.abs(lon - 8.501) < 1e-12);
  assert.ok(Math.abs(new Plane(0, 179.999).enu([0, -179.999])[0] - 222.6) < 0.1); // across the date line
});

test("a tile's corner is in that tile", () => {
  const [x, y] = tileAt(cornerOf(137_000, 91_000, 18), 18);
  assert.ok(Math.abs(x - 137_000) < 1e-6 && Math.abs(y - 91_000) < 1e-6);
  assert.deepEqual(tileAt([0, 0], 1), [1, 1]);
});

test("labels keep clear of each other, and stay on the map", () => {
  const labels = new Labels(fakeContext(), { height: 200 }, {});
  for (let k = 0; k < 2; k++) labels.write("label", 100, 195);
  const heights = labels.taken.map(({ y }) => y);
  assert.ok(heights.every((y) => y <= 191));
  assert.ok(Math.abs(heights[0] - heights[1]) >= 18, String(heights));
});

test("a vehicle that was on the ground when it was heard last is not said to be lost in the air", () => {
  const told = [{ id: 3, by: 2, age_s: 4, silent: true, place: [47, 8] }];
  const line = (vehicles) => peerReports({ told, vehicles })[0];
  assert.match(line([{ id: 3, airborne: false, age_s: 4.5 }]), /^Vehicle 3: link lost on the ground, last 4.0 s ago; reported by 2/);
  assert.match(line([{ id: 3, airborne: false, age_s: 60 }]), /link lost in the air/); // not heard here since, but there
  assert.match(line([{ id: 3, airborne: true, age_s: 4.5 }]), /link lost in the air/);
  assert.match(line([]), /link lost in the air/);
});
