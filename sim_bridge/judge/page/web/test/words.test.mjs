import assert from "node:assert/strict";
import { test } from "node:test";
import { seconds } from "../src/dom.js";
import { shown } from "../src/figures.js";
import { reach } from "../src/shadow.js";
import { wrapped } from "../src/study.js";

test("figures are shown with as many digits as say something", () => {
  const pairs = [[null, "–"], [[], "none"], [[1, 2], "1, 2"], [7, "7"], [true, "yes"], [[null, 0.25], "–, 0.25"], [0.123456, "0.1235"], [1234.56, "1235"], ["text", "text"]];
  for (const [value, text] of pairs) assert.equal(shown(value), text);
  assert.equal(seconds(40), "40.0 s");
});

const trunk = (east, north, radius) => ({ east_m: [east], north_m: [north], radius_m: [radius] });
const far = ([e, n]) => Math.hypot(e, n);

test("a radio reaches as far in every direction where nothing stands", () => {
  for (const at of reach(trunk(5, 0, 0.3), 0, 0, 50, 1)) assert.ok(Math.abs(far(at) - 50) < 1e-9);
});

test("a trunk on the path leaves its share of the range behind it", () => {
  const outline = reach(trunk(0, 10, 0.5), 0, 0, 50, 0.6);
  assert.ok(Math.abs(far(outline[0]) - 30) < 1e-9); // north, through it
  assert.ok(Math.abs(far(outline[360]) - 50) < 1e-9);
});

test("no trunk takes more than what is left behind it", () => {
  assert.ok(Math.abs(far(reach(trunk(0, 40, 0.5), 0, 0, 50, 0.6)[0]) - 40) < 1e-9);
  assert.ok(Math.abs(far(reach(trunk(0, 60, 0.5), 0, 0, 50, 0.6)[0]) - 50) < 1e-9);
});

test("a case's name is told whole, in lines that fit beside its plot", () => {
  const name = `the whole stack size=8 transit_range_m=30.0 placement_spacing_m=6.0 ${"x".repeat(70)}`;
  const lines = wrapped(name);
  assert.equal(lines.join("").replaceAll(" ", ""), name.replaceAll(" ", ""));
  assert.ok(lines.every((line) => line.length <= 32));
  assert.deepEqual(wrapped("ours size=8"), ["ours size=8"]);
});
